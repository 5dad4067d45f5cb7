"""Arrays out of a pickle of somebody else's, without running it.

A pickle can name any function of Python to be called, and numpy trusts the shapes, types and lengths that one holds. So
nothing that a pickle names is made here: stand-ins keep what belongs to arrays of numpy, sparse matrices of scipy and
chumpy's objects, everything else is refused, and an array is built from them only when it is asked for and fits.
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

__all__ = ["ArrayError", "RefusedError", "StandIn", "as_array", "read_pickle", "shown"]

_LARGEST_FILE = 2**30
"""Bytes. The largest published body model takes a quarter of that."""
_LARGEST_MATRIX = 2**24
"""Numbers of a sparse matrix that is filled up. SMPL's takes 165,000."""
_DEEPEST = 8
_MOST_NUMBERS = 2**60
"""Of an array whose empty axes are taken for one: of 8 bytes each, numpy can count no more."""
_MOST_KEYS = 4096
"""Keys of all dictionaries and sets of a pickle: keys with one hash take time that grows with their number squared."""
_LARGEST_MEMO = 2**31
"""Python writes 0, 1, 2, ...; larger numbers could share one hash."""
_LONGEST_TEXT = 80
_CODE = re.compile(r"[biufcSU][0-9]{1,6}")


class RefusedError(Exception):
    """A pickle names something that may not be made; the message is its name."""


class ArrayError(Exception):
    """What a pickle holds is no array, or does not fit together; the message begins with a verb."""


def read_pickle(path: Path) -> dict[str, Any]:
    """The items of a pickled dictionary: plain values, and stand-ins for :func:`as_array`.

    Raises:
        RefusedError: it names something that could run code.
        ArrayError: it holds no dictionary.
        Exception: whatever a file raises that is no pickle.
    """
    if path.stat().st_size > _LARGEST_FILE:
        raise ArrayError(f"takes {path.stat().st_size / 2**30:.1f} GiB, where no body model takes more than 1")
    # Python's own unpickler keeps its memo in a dictionary; that of C makes room for any number that a file names.
    found = _Unpickler(_Content(path.read_bytes()), encoding="latin1").load()
    if not isinstance(found, dict):
        raise ArrayError(f"holds a {type(found).__name__}, not the arrays of a body")
    return {name: value for name, value in found.items() if isinstance(name, str)}


def as_array(value: Any) -> NDArray[Any]:
    """The array that a value of :func:`read_pickle` stands for.

    Raises:
        ArrayError: it is none, or its parts do not fit together.
    """
    try:
        return _dense(value, 0)
    except (ValueError, TypeError, OverflowError, MemoryError) as error:  # of numpy, which trusts what it gets
        raise ArrayError("is an array whose parts do not fit together") from error


def shown(text: str) -> str:
    """A text of somebody else's for a message: one line, in ASCII, of at most 80 characters."""
    safe = ascii(text[: _LONGEST_TEXT + 1])[1:-1]
    return safe if len(safe) <= _LONGEST_TEXT else f"{safe[: _LONGEST_TEXT - 3]}..."


class StandIn:
    """Keeps the state of an object without being one."""

    def __init__(self, *_: Any) -> None:
        self.state: Any = {}

    def __setstate__(self, state: Any) -> None:
        self.state = state

    def part(self, name: str) -> Any:
        """One item of the state, where that is a dictionary; None otherwise."""
        return self.state.get(name) if isinstance(self.state, dict) else None

    def dense(self, depth: int) -> NDArray[Any]:
        """Its numbers.

        Raises:
            ArrayError: it has none.
        """
        raise ArrayError("is no array of numbers")


class _DType(StandIn):
    """Of numpy's types, by their code."""

    def __init__(self, code: Any = None, *_: Any) -> None:
        super().__init__()
        self.code = code

    def real(self) -> np.dtype[Any]:
        if not isinstance(self.code, str) or not _CODE.fullmatch(self.code):
            raise ArrayError(f"holds {'objects' if self.code == 'O8' else 'no numbers'}, not numbers")
        try:
            found: np.dtype[Any] = np.dtype(self.code)
        except TypeError as error:
            raise ArrayError(f"is of a type '{self.code}', which numpy does not have") from error
        order = self.state[1] if isinstance(self.state, tuple) and len(self.state) > 1 else "="
        return found.newbyteorder(">") if order == ">" else found.newbyteorder("<") if order == "<" else found


class _Array(StandIn):
    """Of numpy's arrays: (version, shape, type, whether columns come first, bytes)."""

    def dense(self, depth: int) -> NDArray[Any]:
        if not isinstance(self.state, tuple) or len(self.state) != 5:
            raise ArrayError("is an array without its numbers")
        _, shape, kind, columns_first, data = self.state
        if not isinstance(kind, _DType):
            raise ArrayError("is an array without a type")
        dtype, shape = kind.real(), _shape(shape)
        if isinstance(data, str):
            data = data.encode("latin1")  # how bytes of Python 2 are read
        if not isinstance(data, (bytes, bytearray)) or prod(shape) * dtype.itemsize != len(data):
            size = len(data) if isinstance(data, (bytes, bytearray)) else "no"
            raise ArrayError(f"is said to be {_said(shape)} of {dtype}, and has {size} bytes")
        if not prod(shape):
            return np.empty(shape, dtype)
        order: Any = "F" if columns_first else "C"
        return np.frombuffer(data, dtype).reshape(shape, order=order)


class _FromBuffer(_Array):
    """What protocol 5 makes arrays with."""

    def __init__(self, data: Any = None, kind: Any = None, shape: Any = None, order: Any = "C", *_: Any) -> None:
        super().__init__()
        self.state = (1, shape, kind, order == "F", data)


class _Scalar(StandIn):
    """Of numpy's single numbers."""

    def __init__(self, kind: Any = None, data: Any = None, *_: Any) -> None:
        super().__init__()
        self.kind, self.data = kind, data

    def dense(self, depth: int) -> NDArray[Any]:
        whole = _Array()
        whole.state = (1, (), self.kind, False, self.data)
        return whole.dense(depth)


class _Sparse(StandIn):
    """Of scipy's compressed matrices."""

    by_column = True

    def dense(self, depth: int) -> NDArray[Any]:
        told = self.part("_shape")
        shape = _shape(self.part("shape") if told is None else told)
        if len(shape) != 2 or prod(shape) > _LARGEST_MATRIX:
            raise ArrayError(f"is a sparse matrix of {_said(shape)}, larger than any body model's")
        data, minor, ends = (_dense(self.part(name), depth + 1) for name in ("data", "indices", "indptr"))
        if data.dtype.kind not in "fiu" or minor.dtype.kind not in "iu" or ends.dtype.kind not in "iu":
            raise ArrayError(f"is a sparse matrix of {data.dtype} by {minor.dtype} and {ends.dtype}, not by numbers")
        majors, minors = reversed(shape) if self.by_column else shape
        if data.ndim != 1 or data.shape != minor.shape or ends.shape != (majors + 1,):
            raise ArrayError(
                f"is a sparse matrix of {_said(shape)} with {data.shape} numbers at {minor.shape} places, "
                f"and {ends.shape} ends"
            )
        if ends[0] != 0 or int(ends[-1]) != len(data) or (ends[1:] < ends[:-1]).any():
            raise ArrayError(f"is a sparse matrix whose {len(data)} numbers do not end where it says")
        if len(minor) and (int(minor.min()) < 0 or int(minor.max()) >= minors):
            worst = int(minor.min()) if int(minor.min()) < 0 else int(minor.max())
            raise ArrayError(f"is a sparse matrix of {_said(shape)} with a number at {worst}, outside of it")
        full = np.zeros((majors, minors), data.dtype.newbyteorder("="))
        last = ends.astype(np.int64)
        major = np.repeat(np.arange(majors), last[1:] - last[:-1])
        np.add.at(full, (major, minor.astype(np.int64)), data)
        return full.T if self.by_column else full


class _SparseByRow(_Sparse):
    by_column = False


class _Chumpy(StandIn):
    """Of chumpy's arrays: the numbers themselves, or a choice of another's."""

    def dense(self, depth: int) -> NDArray[Any]:
        if self.part("x") is not None:
            return _dense(self.part("x"), depth + 1)
        if self.part("a") is None or self.part("idxs") is None:
            raise ArrayError("is left for chumpy to compute, and no numbers")
        numbers, chosen = (_dense(self.part(name), depth + 1) for name in ("a", "idxs"))
        numbers = numbers.ravel()
        if chosen.dtype.kind not in "iu":
            raise ArrayError(f"is a choice by {chosen.dtype}, not by whole numbers")
        if chosen.size and (int(chosen.min()) < 0 or int(chosen.max()) >= len(numbers)):
            worst = int(chosen.min()) if int(chosen.min()) < 0 else int(chosen.max())
            raise ArrayError(f"is a choice of number {worst} among {len(numbers)}")
        shape = chosen.shape if self.part("preferred_shape") is None else _shape(self.part("preferred_shape"))
        if prod(shape) != chosen.size:
            raise ArrayError(f"is said to be {_said(shape)}, and has {chosen.size} numbers")
        found: NDArray[Any] = numbers[chosen].reshape(shape)
        return found


class _Reconstructed(StandIn):
    """What makes arrays and old classes: of stand-ins only."""

    def __new__(cls, kind: Any = None, *_: Any) -> Any:
        if not (isinstance(kind, type) and issubclass(kind, StandIn)):
            raise RefusedError(f"the making of {_kind(kind)}")
        return kind()


class _Encoded(StandIn):
    """How new Pythons write bytes for old ones."""

    def __new__(cls, text: Any = "", encoding: Any = "latin1", *_: Any) -> Any:
        if not isinstance(text, str) or encoding not in ("latin1", "latin-1"):
            raise RefusedError(f"bytes in {_kind(encoding)}")
        return text.encode("latin1")


_MADE: dict[tuple[str, str], type[StandIn]] = {
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _DType,
    ("numpy.core.multiarray", "_reconstruct"): _Reconstructed,
    ("numpy.core.multiarray", "scalar"): _Scalar,
    ("numpy.core.numeric", "_frombuffer"): _FromBuffer,
    ("copy_reg", "_reconstructor"): _Reconstructed,
    ("copyreg", "_reconstructor"): _Reconstructed,
    ("__builtin__", "object"): StandIn,
    ("builtins", "object"): StandIn,
    ("_codecs", "encode"): _Encoded,
}


class _Content(io.BytesIO):
    """Of a file, where a length that goes past the end is refused."""

    def read(self, size: int | None = -1, /) -> bytes:
        """The next ``size`` bytes.

        Raises:
            EOFError: there are fewer.
        """
        found = super().read(size)
        if size is not None and len(found) < size:
            raise EOFError(f"{size} bytes are wanted where {len(found)} are left")
        return found


_PYTHON: Any = pickle._Unpickler
"""Whose methods the published types of Python leave out."""
_HASHED = (
    (pickle.SETITEM, slice(-2, -1)),
    (pickle.SETITEMS, slice(None, None, 2)),
    (pickle.DICT, slice(None, None, 2)),
    (pickle.ADDITEMS, slice(None)),
    (pickle.FROZENSET, slice(None)),
)
"""Opcode, and what it hashes of the stack."""


def _load_bytearray8(unpickler: Any) -> None:
    """As Python's, which takes the memory for a length before it looks whether the bytes are there."""
    (size,) = struct.unpack("<Q", unpickler.read(8))
    unpickler.append(bytearray(unpickler.read(size)))


def _with_keys_checked(opcode: bytes, keys: slice) -> Callable[[Any], None]:
    load = _PYTHON.dispatch[opcode[0]]

    def checked(unpickler: Any) -> None:
        hashed = unpickler.stack[keys]
        _check_keys(hashed)
        unpickler.num_keys += len(hashed)
        if unpickler.num_keys > _MOST_KEYS:
            raise pickle.UnpicklingError(f"its dictionaries have more than {_MOST_KEYS} keys")
        load(unpickler)

    return checked


def _load_put(unpickler: Any) -> None:
    """As Python's, for the numbers that Python writes."""
    number = int(unpickler.readline()[:-1])
    if not 0 <= number < _LARGEST_MEMO:
        raise pickle.UnpicklingError(f"it numbers an object as {number}")
    unpickler.memo[number] = unpickler.stack[-1]


class _Unpickler(pickle._Unpickler):
    dispatch: ClassVar[dict[int, Callable[[Any], None]]] = {
        **_PYTHON.dispatch,
        **{opcode[0]: _with_keys_checked(opcode, keys) for opcode, keys in _HASHED},
        pickle.BYTEARRAY8[0]: _load_bytearray8,
        pickle.PUT[0]: _load_put,
    }

    num_keys = 0

    def find_class(self, module: str, name: str) -> Any:
        """What a pickle may name; classes of stand-ins alone, whose state no pickle can set.

        Raises:
            RefusedError: it is not one of these.
        """
        made = _MADE.get((module.replace("numpy._core", "numpy.core"), name))
        if made is not None:
            return made
        if module.split(".")[:2] == ["scipy", "sparse"] and name in ("csc_matrix", "csr_matrix"):
            return _Sparse if name == "csc_matrix" else _SparseByRow
        if module.split(".")[0] == "chumpy":
            return _Chumpy
        raise RefusedError(shown(f"{module}.{name}"))


def _check_keys(keys: list[Any]) -> None:
    """No tuple in a tuple: Python's hash of many inside one another ends the process.

    Raises:
        UnpicklingError: there is one.
    """
    if any(isinstance(part, tuple) for key in keys if isinstance(key, tuple) for part in key):
        raise pickle.UnpicklingError("a tuple in a tuple is the key of a dictionary")


def _dense(value: Any, depth: int) -> NDArray[Any]:
    if not isinstance(value, StandIn):
        raise ArrayError(f"is a {type(value).__name__}, not an array")
    if depth > _DEEPEST:
        raise ArrayError("is a choice of a choice without end")
    return value.dense(depth)


def _kind(value: Any) -> str:
    """Never the ``repr`` of a value, which can be without end."""
    return shown(value) if isinstance(value, str) else f"a {type(value).__name__}"


def _shape(given: Any) -> tuple[int, ...]:
    if not isinstance(given, (tuple, list)) or len(given) > 8:
        raise ArrayError("has no shape")
    sizes = [int(as_array(n)) if isinstance(n, _Scalar) and as_array(n).dtype.kind in "iu" else n for n in given]
    numbers = all(isinstance(n, int) and 0 <= n < _MOST_NUMBERS for n in sizes)
    if not numbers or prod(max(n, 1) for n in sizes) >= _MOST_NUMBERS:  # one axis of 0 would hide the others
        raise ArrayError("has a shape that none can have")
    return tuple(sizes)


def _said(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape)) or "one number"
