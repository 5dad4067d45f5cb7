"""Shapes of arrays, and which have a row for each person, as metadata of fields; type aliases by
dtype.

The aliases are for type checkers only: NumPy is not imported.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    AnyArray = NDArray[Any]
    BoolArray = NDArray[np.bool_]
    FloatArray = NDArray[np.floating[Any]]
    Float32Array = NDArray[np.float32]
    Float64Array = NDArray[np.float64]
    IntArray = NDArray[np.integer[Any]]
    Int64Array = NDArray[np.int64]
    UInt8Array = NDArray[np.uint8]

_Record = TypeVar("_Record")

PER_PERSON: Mapping[str, bool] = MappingProxyType({"per_person": True})
"""Metadata of a field with a row for each person: an array, or a dataclass with such fields."""


def shape(*sizes: str | int) -> dict[str, tuple[str | int, ...]]:
    """Return the metadata of a field whose array has this shape; one letter stands for one size in
    all fields.
    """
    return {"shape": sizes}


def select_people(record: _Record, rows: Any) -> _Record:
    """Return a copy of a dataclass with the rows of some people in its fields of metadata
    :data:`PER_PERSON`.

    Args:
        record: an instance of a dataclass with rows for N people.
        rows: (N,) bool mask, or indices (n,), of the library of the record's arrays. A mask of all
            returns the record.
    """
    if str(rows.dtype).endswith("bool") and rows.all():
        return record
    return _map_rows(record, lambda array: array[rows])


def expand_people(record: _Record, rows: BoolArray) -> _Record:
    """Return a copy of a dataclass of arrays with N rows: its own where ``rows`` (N,) is true, and
    zeros for the other people.
    """
    import numpy as np

    def wider(array: Any) -> Any:
        wide = np.zeros((len(rows), *array.shape[1:]), array.dtype)
        wide[rows] = array
        return wide

    return _map_rows(record, wider)


def with_columns(record: _Record, rows: BoolArray, orders: Mapping[str, Sequence[int]]) -> _Record:
    """Return a copy of a dataclass with copies of its arrays of some names, unless they are None:
    for the people whom ``rows``, (N,) bool, selects, their columns are in the given order.
    """
    changed = {
        name: value.copy() for name in orders if (value := getattr(record, name)) is not None
    }
    for name, value in changed.items():
        value[rows] = value[rows][:, orders[name]]
    return replace(record, **changed)  # type: ignore[type-var]  # as above


def wrong_rows(record: Any, people: int, name: str = "") -> Iterator[str]:
    """Yield each field of a dataclass, and of those in it, that has not a row for each of some
    people: "people.heads has 3 rows".
    """
    for field, value in per_person(record):
        if is_dataclass(value):
            yield from wrong_rows(value, people, f"{name}{field}.")
        elif len(value) != people:
            yield f"{name}{field} has {len(value)} rows"


def _map_rows(record: _Record, change: Callable[[Any], Any]) -> _Record:
    changed = {
        name: _map_rows(value, change) if is_dataclass(value) else change(value)
        for name, value in per_person(record)
    }
    return replace(record, **changed)  # type: ignore[type-var]  # cannot be bound to dataclasses


def per_person(record: Any) -> Iterator[tuple[str, Any]]:
    """Yield name and value of the fields of a dataclass with a row for each person that are not
    None.
    """
    for field in fields(record):
        value = getattr(record, field.name)
        sizes = field.metadata.get("shape", ("",))
        if value is not None and (field.metadata.get("per_person") or sizes[0] == "N"):
            yield field.name, value
