"""Shapes of arrays, and which have a row for each person, as metadata of fields; type aliases by
dtype.

The aliases are for type checkers only: NumPy is not imported.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    BoolArray = NDArray[np.bool_]
    FloatArray = NDArray[np.floating[Any]]
    IntArray = NDArray[np.integer[Any]]
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
    if str(rows.dtype).endswith("bool") and bool(rows.all()):
        return record
    changed = {}
    for field in fields(record):  # type: ignore[arg-type]  # a type variable cannot be bound to dataclasses
        value = getattr(record, field.name)
        if value is not None and field.metadata.get("per_person"):
            changed[field.name] = (
                value[rows] if hasattr(value, "__getitem__") else select_people(value, rows)
            )
    return replace(record, **changed)  # type: ignore[type-var]
