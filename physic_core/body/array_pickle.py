"""Read arrays from an untrusted pickle without running code.

A pickle can name any Python function to be called, and numpy trusts the shapes, types and lengths in it. So no object
that a pickle names is created. Placeholders store the state of numpy arrays, scipy sparse matrices and chumpy arrays;
all other names are refused. An array is built from a placeholder only on request, and only if its parts are consistent.
"""

from __future__ import annotations

import io
import pickle
import re
import struct
from collections.abc import Callable
from math import prod
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "InvalidArrayError",
    "PickledObject",
    "UnsafePickleError",
    "as_array",
    "escape_unprintable",
    "read_pickle",
    "read_pickled_items",
]

_MAX_FILE_BYTES = 2**30
"""Bytes. The largest published body model has a quarter of that."""
_MAX_MATRIX_SIZE = 2**24
"""Maximum number of elements of a sparse matrix that is made dense. That of SMPL has 165,000."""
_MAX_DEPTH = 8
_MAX_ARRAY_SIZE = 2**60
"""Maximum product of the axis lengths, empty axes counted as 1: with 8 bytes each, the limit of numpy."""
_MAX_KEYS = 4096
"""Maximum number of keys of all dictionaries and sets: keys with equal hashes take quadratic time."""
_MAX_MEMO = 2**31
"""Maximum memo index. Python writes 0, 1, 2, ...; larger numbers could have equal hashes."""
_MAX_TEXT = 80
_DTYPE_CODE = re.compile(r"[biufcSU][0-9]{1,6}")


class UnsafePickleError(Exception):
    """A pickle refers to a class or function that is not allowed. The message is the refused name."""


class InvalidArrayError(Exception):
    """A pickled value is not an array, or its shape and data are inconsistent. The message begins with a verb."""


def read_pickle(path: Path) -> dict[str, Any]:
    """Read a pickled dictionary, with a placeholder for each array, to be converted by :func:`as_array`.

    Raises:
        UnsafePickleError: it names an object that could run code.
        InvalidArrayError: it is not a dictionary.
        Exception: any error of a file that is not a pickle.
    """
    if path.stat().st_size > _MAX_FILE_BYTES:
        raise InvalidArrayError(f"takes {path.stat().st_size / 2**30:.1f} GiB, where no body model takes more than 1")
    # Python's own unpickler has a dictionary as its memo; the C version allocates memory for any index in a file.
    found = _Unpickler(_BoundedStream(path.read_bytes()), encoding="latin1").load()
    if not isinstance(found, dict):
        raise InvalidArrayError(f"holds a {type(found).__name__}, not the arrays of a body")
    return {name: value for name, value in found.items() if isinstance(name, str)}


def read_pickled_items(data: bytes) -> list[Any]:
    """Read a pickled one-dimensional array of Python objects, with placeholders as in :func:`read_pickle`.

    Raises:
        UnsafePickleError: it names an object that could run code.
        InvalidArrayError: it is not such an array.
        Exception: any error of data that is not a pickle.
    """
    found = _Unpickler(_BoundedStream(data), encoding="latin1").load()
    state = found.state if isinstance(found, _Array) else None
    if not isinstance(state, tuple) or len(state) != 5 or not isinstance(state[4], list):
        raise InvalidArrayError("is no array of objects")
    if _shape(state[1]) != (len(state[4]),):
        raise InvalidArrayError("is an array of objects whose shape does not fit")
    return state[4]


def as_array(value: Any) -> NDArray[Any]:
    """Convert a value of :func:`read_pickle` to an array.

    Raises:
        InvalidArrayError: it is not an array, or its parts are inconsistent.
    """
    try:
        return _dense(value, 0)
    except (ValueError, TypeError, OverflowError, MemoryError) as error:  # of numpy, which trusts what it gets
        raise InvalidArrayError("is an array whose parts do not fit together") from error


def escape_unprintable(text: str) -> str:
    """Return untrusted text for a message: one line, in ASCII, of at most 80 characters."""
    safe = ascii(text[: _MAX_TEXT + 1])[1:-1]
    return safe if len(safe) <= _MAX_TEXT else f"{safe[: _MAX_TEXT - 3]}..."


class PickledObject:
    """Placeholder that stores the state of a pickled object."""

    def __init__(self, *_: Any) -> None:
        self.state: Any = {}

    def __setstate__(self, state: Any) -> None:
        self.state = state

    def part(self, name: str) -> Any:
        """Return the item ``name`` of the pickled state; None if the state is not a dictionary or has no such item."""
        return self.state.get(name) if isinstance(self.state, dict) else None

    def dense(self, depth: int) -> NDArray[Any]:
        """Return the dense array that this placeholder stands for.

        Raises:
            InvalidArrayError: it is not an array.
        """
        raise InvalidArrayError("is no array of numbers")


class _DType(PickledObject):
    """Placeholder of a numpy dtype, with its type code."""

    def __init__(self, code: Any = None, *_: Any) -> None:
        super().__init__()
        self.code = code

    def to_dtype(self) -> np.dtype[Any]:
        if not isinstance(self.code, str) or not _DTYPE_CODE.fullmatch(self.code):
            raise InvalidArrayError(f"holds {'objects' if self.code == 'O8' else 'no numbers'}, not numbers")
        try:
            found: np.dtype[Any] = np.dtype(self.code)
        except TypeError as error:
            raise InvalidArrayError(f"is of a type '{self.code}', which numpy does not have") from error
        order = self.state[1] if isinstance(self.state, tuple) and len(self.state) > 1 else "="
        return found.newbyteorder(">") if order == ">" else found.newbyteorder("<") if order == "<" else found


class _Array(PickledObject):
    """Placeholder of a numpy array; its state is (version, shape, dtype, is Fortran order, bytes)."""

    def dense(self, depth: int) -> NDArray[Any]:
        if not isinstance(self.state, tuple) or len(self.state) != 5:
            raise InvalidArrayError("is an array without its numbers")
        _, shape, kind, columns_first, data = self.state
        if not isinstance(kind, _DType):
            raise InvalidArrayError("is an array without a type")
        dtype, shape = kind.to_dtype(), _shape(shape)
        if isinstance(data, str):
            data = data.encode("latin1")  # how bytes of Python 2 are read
        if not isinstance(data, (bytes, bytearray)) or prod(shape) * dtype.itemsize != len(data):
            size = len(data) if isinstance(data, (bytes, bytearray)) else "no"
            raise InvalidArrayError(f"must be {_shape_text(shape)} of {dtype}, and has {size} bytes")
        if not prod(shape):
            return np.empty(shape, dtype)
        order: Any = "F" if columns_first else "C"
        return np.frombuffer(data, dtype).reshape(shape, order=order)


class _FromBuffer(_Array):
    """Placeholder of a numpy array in pickle protocol 5."""

    def __init__(self, data: Any = None, kind: Any = None, shape: Any = None, order: Any = "C", *_: Any) -> None:
        super().__init__()
        self.state = (1, shape, kind, order == "F", data)


class _Scalar(PickledObject):
    """Placeholder of a numpy scalar."""

    def __init__(self, kind: Any = None, data: Any = None, *_: Any) -> None:
        super().__init__()
        self.kind, self.data = kind, data

    def dense(self, depth: int) -> NDArray[Any]:
        array = _Array()
        array.state = (1, (), self.kind, False, self.data)
        return array.dense(depth)


class _Sparse(PickledObject):
    """Placeholder of a scipy sparse matrix, compressed by column."""

    by_column = True

    def dense(self, depth: int) -> NDArray[Any]:
        shape = self.part("_shape")
        shape = _shape(self.part("shape") if shape is None else shape)
        if len(shape) != 2 or prod(shape) > _MAX_MATRIX_SIZE:
            raise InvalidArrayError(f"is a sparse matrix of {_shape_text(shape)}, larger than any body model's")
        data, minor, ends = (_dense(self.part(name), depth + 1) for name in ("data", "indices", "indptr"))
        if data.dtype.kind not in "fiu" or minor.dtype.kind not in "iu" or ends.dtype.kind not in "iu":
            raise InvalidArrayError(
                f"is a sparse matrix of {data.dtype} by {minor.dtype} and {ends.dtype}, not by numbers"
            )
        majors, minors = reversed(shape) if self.by_column else shape
        if data.ndim != 1 or data.shape != minor.shape or ends.shape != (majors + 1,):
            raise InvalidArrayError(
                f"is a sparse matrix of {_shape_text(shape)} with {data.shape} numbers at {minor.shape} places, "
                f"and {ends.shape} ends"
            )
        if ends[0] != 0 or int(ends[-1]) != len(data) or (ends[1:] < ends[:-1]).any():
            raise InvalidArrayError(f"is a sparse matrix whose {len(data)} numbers do not end where it says")
        if len(minor) and (int(minor.min()) < 0 or int(minor.max()) >= minors):
            worst = int(minor.min()) if int(minor.min()) < 0 else int(minor.max())
            raise InvalidArrayError(
                f"is a sparse matrix of {_shape_text(shape)} with a number at {worst}, outside of it"
            )
        full = np.zeros((majors, minors), data.dtype.newbyteorder("="))
        last = ends.astype(np.int64)
        major = np.repeat(np.arange(majors), last[1:] - last[:-1])
        np.add.at(full, (major, minor.astype(np.int64)), data)
        return full.T if self.by_column else full


class _SparseByRow(_Sparse):
    by_column = False


class _Chumpy(PickledObject):
    """Placeholder of a chumpy array: its numbers, or a selection of the numbers of another one."""

    def dense(self, depth: int) -> NDArray[Any]:
        if self.part("x") is not None:
            return _dense(self.part("x"), depth + 1)
        if self.part("a") is None or self.part("idxs") is None:
            raise InvalidArrayError("is left for chumpy to compute, and no numbers")
        numbers, chosen = (_dense(self.part(name), depth + 1) for name in ("a", "idxs"))
        numbers = numbers.ravel()
        if chosen.dtype.kind not in "iu":
            raise InvalidArrayError(f"is a choice by {chosen.dtype}, not by whole numbers")
        if chosen.size and (int(chosen.min()) < 0 or int(chosen.max()) >= len(numbers)):
            worst = int(chosen.min()) if int(chosen.min()) < 0 else int(chosen.max())
            raise InvalidArrayError(f"is a choice of number {worst} among {len(numbers)}")
        shape = chosen.shape if self.part("preferred_shape") is None else _shape(self.part("preferred_shape"))
        if prod(shape) != chosen.size:
            raise InvalidArrayError(f"must be {_shape_text(shape)}, and has {chosen.size} numbers")
        found: NDArray[Any] = numbers[chosen].reshape(shape)
        return found


class _Reconstructed(PickledObject):
    """Placeholder of the functions that create arrays and old-style classes; accepts placeholder classes only."""

    def __new__(cls, kind: Any = None, *_: Any) -> Any:
        if not (isinstance(kind, type) and issubclass(kind, PickledObject)):
            raise UnsafePickleError(f"the making of {_describe(kind)}")
        return kind()


class _Encoded(PickledObject):
    """Placeholder of ``_codecs.encode``, by which Python 3 writes bytes for Python 2; accepts latin1 only."""

    def __new__(cls, text: Any = "", encoding: Any = "latin1", *_: Any) -> Any:
        if not isinstance(text, str) or encoding not in ("latin1", "latin-1"):
            raise UnsafePickleError(f"bytes in {_describe(encoding)}")
        return text.encode("latin1")


_PLACEHOLDERS: dict[tuple[str, str], type[PickledObject]] = {
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _DType,
    ("numpy.core.multiarray", "_reconstruct"): _Reconstructed,
    ("numpy.core.multiarray", "scalar"): _Scalar,
    ("numpy.core.numeric", "_frombuffer"): _FromBuffer,
    ("copy_reg", "_reconstructor"): _Reconstructed,
    ("copyreg", "_reconstructor"): _Reconstructed,
    ("__builtin__", "object"): PickledObject,
    ("builtins", "object"): PickledObject,
    ("_codecs", "encode"): _Encoded,
}


class _BoundedStream(io.BytesIO):
    """Byte stream that raises EOFError for a length beyond its end."""

    def read(self, size: int | None = -1, /) -> bytes:
        """Return the next ``size`` bytes.

        Raises:
            EOFError: fewer are left.
        """
        found = super().read(size)
        if size is not None and len(found) < size:
            raise EOFError(f"{size} bytes are wanted where {len(found)} are left")
        return found


_PYTHON: Any = pickle._Unpickler
"""Python's unpickler; its published types omit the methods."""
_HASHING_OPCODES = (
    (pickle.SETITEM, slice(-2, -1)),
    (pickle.SETITEMS, slice(None, None, 2)),
    (pickle.DICT, slice(None, None, 2)),
    (pickle.ADDITEMS, slice(None)),
    (pickle.FROZENSET, slice(None)),
)
"""Opcode, and the part of the stack that it hashes."""


def _load_bytearray8(unpickler: Any) -> None:
    """Read a bytearray; unlike Python's version, it allocates memory only for bytes that exist."""
    (size,) = struct.unpack("<Q", unpickler.read(8))
    unpickler.append(bytearray(unpickler.read(size)))


def _with_keys_checked(opcode: bytes, keys: slice) -> Callable[[Any], None]:
    """Wrap the handler of an opcode to check and count the dictionary keys first."""
    load = _PYTHON.dispatch[opcode[0]]

    def checked(unpickler: Any) -> None:
        hashed = unpickler.stack[keys]
        _check_keys(hashed)
        unpickler.num_keys += len(hashed)
        if unpickler.num_keys > _MAX_KEYS:
            raise pickle.UnpicklingError(f"its dictionaries have more than {_MAX_KEYS} keys")
        load(unpickler)

    return checked


def _load_put(unpickler: Any) -> None:
    """Store an object in the memo, with an index as Python writes them."""
    number = int(unpickler.readline()[:-1])
    if not 0 <= number < _MAX_MEMO:
        raise pickle.UnpicklingError(f"it numbers an object as {number}")
    unpickler.memo[number] = unpickler.stack[-1]


class _Unpickler(pickle._Unpickler):
    """Unpickler that creates placeholders only."""

    dispatch: ClassVar[dict[int, Callable[[Any], None]]] = {
        **_PYTHON.dispatch,
        **{opcode[0]: _with_keys_checked(opcode, keys) for opcode, keys in _HASHING_OPCODES},
        pickle.BYTEARRAY8[0]: _load_bytearray8,
        pickle.PUT[0]: _load_put,
    }

    num_keys = 0

    def find_class(self, module: str, name: str) -> Any:
        """Return the placeholder class of a name. Classes have no state that a pickle can set.

        Raises:
            UnsafePickleError: the name is not allowed.
        """
        placeholder = _PLACEHOLDERS.get((module.replace("numpy._core", "numpy.core"), name))
        if placeholder is not None:
            return placeholder
        if module.split(".")[:2] == ["scipy", "sparse"] and name in ("csc_matrix", "csr_matrix"):
            return _Sparse if name == "csc_matrix" else _SparseByRow
        if module.split(".")[0] == "chumpy":
            return _Chumpy
        raise UnsafePickleError(escape_unprintable(f"{module}.{name}"))


def _check_keys(keys: list[Any]) -> None:
    """Refuse a tuple inside a tuple as a key: the hash of deeply nested tuples crashes Python.

    Raises:
        UnpicklingError: such a key exists.
    """
    if any(isinstance(part, tuple) for key in keys if isinstance(key, tuple) for part in key):
        raise pickle.UnpicklingError("a tuple in a tuple is the key of a dictionary")


def _dense(value: Any, depth: int) -> NDArray[Any]:
    """Convert a placeholder to an array; ``depth`` counts the nested placeholders."""
    if not isinstance(value, PickledObject):
        raise InvalidArrayError(f"is a {type(value).__name__}, not an array")
    if depth > _MAX_DEPTH:
        raise InvalidArrayError("is a choice of a choice without end")
    return value.dense(depth)


def _describe(value: Any) -> str:
    """Return a description of a value for messages; never its ``repr``, which can be endless."""
    return escape_unprintable(value) if isinstance(value, str) else f"a {type(value).__name__}"


def _shape(given: Any) -> tuple[int, ...]:
    """Return a valid array shape, or raise InvalidArrayError."""
    if not isinstance(given, (tuple, list)) or len(given) > 8:
        raise InvalidArrayError("has no shape")
    sizes = [int(as_array(n)) if isinstance(n, _Scalar) and as_array(n).dtype.kind in "iu" else n for n in given]
    numbers = all(isinstance(n, int) and 0 <= n < _MAX_ARRAY_SIZE for n in sizes)
    if not numbers or prod(max(n, 1) for n in sizes) >= _MAX_ARRAY_SIZE:  # one axis of 0 would hide the others
        raise InvalidArrayError("has a shape that none can have")
    return tuple(sizes)


def _shape_text(shape: tuple[int, ...]) -> str:
    """Return a shape as text, such as "3 x 4"."""
    return " x ".join(map(str, shape)) or "one number"
