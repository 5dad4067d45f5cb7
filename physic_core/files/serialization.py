"""Dataclasses as JSON values and named arrays, and back, by the types of their fields.

An array is named by its place: ``result.people[0].vertices`` is "people.0.vertices". All else is
JSON. A field with the metadata ``stored=False`` is skipped. The metadata ``shape`` lists the sizes
of an array, numbers or letters: one letter stands for one size in all arrays.
"""

from __future__ import annotations

import json
import sys
import types as builtin_types
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from physic_core import types
from physic_core.files.atomic import atomic_write, open_regular
from physic_core.files.npz import read_arrays, write_arrays
from physic_core.files.text import from_json, parse_json, to_json

if TYPE_CHECKING:
    from physic_core.types import AnyArray

Arrays = dict[str, NDArray[Any]]

_DOCUMENT = "document"
_STORED = "iufc"  # kinds of dtype that compress badly; masks and texts do well


class DamagedFileError(Exception):
    """Raised if a file is damaged, or was not written by :func:`write_value`."""


def split(value: Any, arrays: Arrays, path: str = "") -> Any:
    """Return the JSON form of a value, and add its arrays to ``arrays``.

    Args:
        value: a dataclass, an array, a tensor on the CPU, a number, a text, None, or tuples, lists
            and mappings of these.
        arrays: by name; filled.
        path: of the value, with a dot at its end.

    Raises:
        TypeError: the value contains an object of another class.
    """
    if isinstance(value, np.ndarray) or _is_tensor(type(value)):
        arrays[path[:-1]] = np.asarray(value)
        return None
    if is_dataclass(value):
        names = [
            record_field.name
            for record_field in fields(value)
            if record_field.init and record_field.metadata.get("stored", True)
        ]
        parts = {name: split(getattr(value, name), arrays, f"{path}{name}.") for name in names}
        return {name: part for name, part in parts.items() if f"{path}{name}" not in arrays}
    if isinstance(value, Mapping):
        return {str(key): split(item, arrays, f"{path}{key}.") for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [split(item, arrays, f"{path}{index}.") for index, item in enumerate(value)]
    if value is None or isinstance(value, bool | int | float | str | np.generic):
        return to_json(value)
    raise TypeError(f"{path[:-1]} is a {type(value).__name__}, which cannot be stored.")


def join(
    kind: Any,
    value: Any,
    arrays: Mapping[str, AnyArray],
    *,
    sizes: Mapping[str, int] | None = None,
    named: Iterable[Any] = (),
) -> Any:
    """Restore a value from its JSON form and its arrays; lists are restored as tuples where the
    type says so.

    Args:
        kind: type of the value.
        value: as returned by :func:`split`.
        arrays: by name; others than those of the value are ignored.
        sizes: letter of a shape -> size, where known.
        named: dataclasses that fields name and that their modules import for type checkers only;
            those of :mod:`physic_core.types` need not be given.

    Raises:
        KeyError, TypeError, ValueError: an entry or array is missing, or not of the type or shape
            of its field; or the dataclass refuses it.
    """
    return _Join(arrays, dict(sizes or {}), tuple(named)).value(kind, value, "")


def write_value(path: Path, value: Any, head: Mapping[str, Any] | None = None) -> None:
    """Write a value to a file that only its owner can read, completely or not at all.

    Its folder is created if missing.

    Args:
        path: of the file.
        value: as of :func:`split`.
        head: further entries of the document, JSON-ready.

    Raises:
        TypeError: the value cannot be stored.
        OSError, OutputError: the disk is full, or the folder cannot be written.
    """
    arrays: Arrays = {}
    document = {**(head or {}), "kind": type(value).__name__, "value": split(value, arrays)}
    arrays = {name: np.asarray(array, order="C") for name, array in arrays.items()}
    text = np.frombuffer(json.dumps(document, allow_nan=False).encode(), np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path.parent, lock=False) as temporary:
        temporary(path.name).touch(mode=0o600)
        write_arrays(temporary(path.name), {**arrays, _DOCUMENT: text}, stored=_STORED)


def read_value(path: Path, kinds: Iterable[Any], head: Mapping[str, Any] | None = None) -> Any:
    """Read a value from a file of :func:`write_value`, and verify all checksums.

    Args:
        path: of the file.
        kinds: types that the value may have, and those that are ``named`` as of :func:`join`.
        head: entries that the document must have.

    Raises:
        OSError: the file is missing or cannot be read.
        DamagedFileError: the file is damaged, or has another head or a value of another type.
    """
    if path.exists() and not path.is_file():
        raise DamagedFileError("it is not a regular file")  # opening a pipe would block for ever
    with open_regular(path) as stream:
        try:
            arrays = read_arrays(stream)
            document = parse_json(arrays.pop(_DOCUMENT).tobytes())
            if other := [name for name, entry in (head or {}).items() if document[name] != entry]:
                raise ValueError(f"its {other[0]} is {document[other[0]]!r:.60}")
            by_name = {kind.__name__: kind for kind in kinds}
            return join(
                by_name[document["kind"]], document["value"], arrays, named=by_name.values()
            )
        # zipfile, zlib, numpy and json raise a dozen classes for flipped and missing bytes
        except Exception as error:
            raise DamagedFileError(f"{type(error).__name__}: {error}") from error


@dataclass(frozen=True)
class _Join:
    """The arrays of a value that is restored, the sizes of the letters of shapes so far, and named
    dataclasses.
    """

    arrays: Mapping[str, AnyArray]
    sizes: dict[str, int]
    named: tuple[Any, ...]

    def value(self, hint: Any, value: Any, path: str) -> Any:
        kinds = _alternatives(hint)
        if (name := path[:-1]) in self.arrays:
            return _checked(self.arrays[name], kinds, name)
        if value is None and type(None) in kinds:
            return None
        kind = next(
            (alternative for alternative in kinds if _matches_type(alternative, value)), None
        )
        if kind is None:
            raise TypeError(f"{name or 'the value'} is {value!r:.60}")
        if is_dataclass(kind):
            return self._record(kind, value, path)
        origin = get_origin(kind)
        inner = get_args(kind)
        if isinstance(value, Mapping):
            key, item = inner or (str, Any)
            return {
                key(alternative): self.value(item, part, f"{path}{alternative}.")
                for alternative, part in value.items()
            }
        if isinstance(value, list):
            is_fixed = origin is tuple and inner[-1] is not Ellipsis
            each = inner[0] if inner else Any
            hints = inner if is_fixed else (each,) * len(value)
            parts = enumerate(zip(hints, value, strict=True))
            values = [
                self.value(alternative, part, f"{path}{index}.")
                for index, (alternative, part) in parts
            ]
            return tuple(values) if origin is tuple else values
        if isinstance(kind, type) and issubclass(kind, Enum):
            return kind(value)
        return value if kind is str else from_json(value)

    def _record(self, kind: Any, value: Mapping[str, Any], path: str) -> Any:
        values = {}
        for one in fields(kind):
            name = f"{path}{one.name}"
            if name in self.arrays or one.name in value:
                values[one.name] = self.value(
                    _hints(kind, self.named)[one.name], value.get(one.name), f"{name}."
                )
                self._check_shape(one.metadata.get("shape"), name)
            elif one.init and one.default is MISSING and one.default_factory is MISSING:
                raise ValueError(f"it has no {name}")
        return kind(**values)

    def _check_shape(self, wanted: Sequence[str | int] | None, name: str) -> None:
        if wanted is None or name not in self.arrays:
            return
        shape = self.arrays[name].shape
        sizes = [
            self.sizes.setdefault(n, k) if isinstance(n, str) else n
            for n, k in zip(wanted, shape, strict=False)
        ]
        if len(wanted) != len(shape) or tuple(sizes) != shape:
            known = [str(self.sizes.get(str(n), n)) for n in wanted]
            raise ValueError(f"{name} has the shape {shape}, not ({', '.join(known)})")


def _alternatives(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, builtin_types.UnionType) else (hint,)


def _matches_type(kind: Any, value: Any) -> bool:
    """Return whether a JSON value is one of a type, which is not a union."""
    origin = get_origin(kind) or kind
    if origin is Any:
        return True
    if origin is Literal:
        return value in get_args(kind)
    if is_dataclass(origin):
        return isinstance(value, Mapping)
    if origin is float:
        return isinstance(from_json(value), int | float) and not isinstance(value, bool)
    if origin in (int, str, bool, builtin_types.NoneType):
        return type(value) is origin
    if not isinstance(origin, type) or issubclass(origin, np.ndarray):
        return False
    if issubclass(origin, Enum):
        return isinstance(value, str)
    if issubclass(origin, Mapping):
        return isinstance(value, Mapping)
    return issubclass(origin, Iterable) and isinstance(value, list)


def _is_tensor(kind: Any) -> bool:
    """Return whether a type is torch.Tensor, without importing torch."""
    return getattr(kind, "__module__", "") == "torch" and getattr(kind, "__name__", "") == "Tensor"


def _checked(array: AnyArray, kinds: Sequence[Any], name: str) -> Any:
    """Return an array if one of the alternative types allows its dtype, as a tensor if one of them
    is Tensor.
    """
    if any(_is_tensor(kind) for kind in kinds):
        import torch

        return torch.tensor(array)
    allowed = [one for one in kinds if one is Any or (get_origin(one) or one) is np.ndarray]
    scalars = [get_args(get_args(one)[1])[0] if get_args(one) else Any for one in allowed]
    if not array.dtype.isnative or not any(
        scalar is Any or np.issubdtype(array.dtype, get_origin(scalar) or scalar)
        for scalar in scalars
    ):
        order = "" if array.dtype.isnative else " in the other byte order"
        raise TypeError(f"{name} is an array of {array.dtype.name}{order}")
    return array


@cache
def _hints(kind: type, named: tuple[Any, ...]) -> dict[str, Any]:
    """Return the types of the fields of a dataclass, also where names are imported for type
    checkers only.
    """
    names = {name: getattr(types, name) for name in types.__all__}
    names |= {one.__name__: one for one in named if isinstance(one, type)}
    names |= {
        "np": np,
        "NDArray": NDArray,
        "AnyArray": NDArray[Any],
        "BoolArray": NDArray[np.bool_],
        "Float32Array": NDArray[np.float32],
        "Float64Array": NDArray[np.float64],
        "FloatArray": NDArray[np.floating[Any]],
        "Int64Array": NDArray[np.int64],
        "IntArray": NDArray[np.integer[Any]],
        "UInt8Array": NDArray[np.uint8],
    }
    return get_type_hints(kind, localns=names | vars(sys.modules[kind.__module__]))
