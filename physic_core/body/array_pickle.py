"""Read arrays from an untrusted pickle without running code.

A pickle can name any Python function to be called. So no object that a pickle names is created,
not even of numpy: with the state of a dtype, a pickle makes bytes pass for pointers.
Placeholders store the state of numpy arrays, scipy sparse matrices and chumpy arrays; all other
names are refused. An array is built from a placeholder only on request, by functions that check
whether its parts are consistent.
"""

from __future__ import annotations

import io
import operator
import pickle
import re
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import AnyArray


_MAX_FILE_BYTES = 2**30
"""Bytes. The largest published body model has a quarter of that."""
_MAX_MATRIX_SIZE = 2**24
"""Maximum number of elements of a sparse matrix that is made dense. That of SMPL has 165,000."""
_MAX_TEXT = 80
_DTYPE_CODE = re.compile(r"[biufcSU][0-9]{1,6}")


class UnsafePickleError(Exception):
    """A pickle refers to a class or function that is not allowed.

    The message is the refused name.
    """


class InvalidArrayError(Exception):
    """A pickled value is not an array, or its shape and data are inconsistent.

    The message begins with a verb.
    """


def read_pickle(path: Path) -> dict[str, Any]:
    """Read a pickled dictionary, with a placeholder for each array, to be converted by
    :func:`as_array`.

    Raises:
        UnsafePickleError: it names an object that could run code.
        InvalidArrayError: it is not a dictionary.
        pickle.UnpicklingError: the file is not a complete pickle.
    """
    if path.stat().st_size > _MAX_FILE_BYTES:
        raise InvalidArrayError(
            f"takes {path.stat().st_size / 2**30:.1f} GiB, where no body model takes more than 1"
        )
    try:
        content = _Unpickler(io.BytesIO(path.read_bytes()), encoding="latin1").load()
    except (UnsafePickleError, InvalidArrayError, RecursionError):
        raise
    except Exception as error:  # a pickle that is cut off or changed can fail in any way
        raise pickle.UnpicklingError(
            escape_unprintable(str(error)) or type(error).__name__
        ) from error
    if not isinstance(content, dict):
        raise InvalidArrayError(f"holds a {type(content).__name__}, not the arrays of a body")
    return {name: value for name, value in content.items() if isinstance(name, str)}


def read_plain(data: bytes) -> Any:
    """Return the dictionaries, lists, texts, numbers and arrays of a pickle, also of one that
    joblib wrote, without running code.

    Raises:
        UnsafePickleError: it names an object that could run code.
        InvalidArrayError: an array in it is inconsistent.
        pickle.UnpicklingError: it is not a complete pickle.
    """
    try:
        return _without_placeholders(_Unpickler(io.BytesIO(data), encoding="latin1").load())
    except (UnsafePickleError, InvalidArrayError, RecursionError):
        raise
    except Exception as error:  # a pickle that is cut off or changed can fail in any way
        raise pickle.UnpicklingError(
            escape_unprintable(str(error)) or type(error).__name__
        ) from error


def _without_placeholders(value: Any) -> Any:
    """Return a value with arrays in place of placeholders, and lists in place of object arrays."""
    if isinstance(value, _Array) and isinstance(value.state[-1], list):
        items = [_without_placeholders(item) for item in value.state[-1]]
        return items if value.state[1] else items[0]
    if isinstance(value, PickledObject):
        array = as_array(value)
        return array if array.ndim else array[()]
    if isinstance(value, dict):
        return {key: _without_placeholders(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_placeholders(item) for item in value]
    return value


def as_array(value: Any) -> AnyArray:
    """Convert a value of :func:`read_pickle` to an array.

    Raises:
        InvalidArrayError: it is not an array, or its parts are inconsistent.
    """
    if not isinstance(value, PickledObject):
        raise InvalidArrayError(f"is a {type(value).__name__}, not an array")
    try:
        return value.dense()
    except (ValueError, TypeError, IndexError, OverflowError, MemoryError, RecursionError) as error:
        raise InvalidArrayError("is an array whose parts do not fit together") from error


def escape_unprintable(text: str) -> str:
    """Return untrusted text for a message: one line, in ASCII, of at most 80 characters."""
    safe = ascii(text[: _MAX_TEXT + 1])[1:-1]
    return safe if len(safe) <= _MAX_TEXT else f"{safe[: _MAX_TEXT - 3]}..."


class PickledObject:
    """Placeholder that stores the arguments and the state of a pickled object."""

    arguments: tuple[Any, ...] = ()
    state: Any = None

    def __init__(self, *arguments: Any) -> None:
        self.arguments = arguments

    def __setstate__(self, state: Any) -> None:
        self.state = state

    def part(self, name: str) -> Any:
        """Return the item ``name`` of the pickled state; None if the state is not a dictionary or
        has no such item.
        """
        return self.state.get(name) if isinstance(self.state, dict) else None

    def dense(self) -> AnyArray:
        """Return the dense array that this placeholder stands for.

        Raises:
            InvalidArrayError: it is not an array.
            ValueError, TypeError, ...: its parts are inconsistent.
        """
        raise InvalidArrayError("is not an array of numbers")


class _DType(PickledObject):
    """Placeholder of a numpy dtype; its first argument is the type code."""

    def to_dtype(self) -> np.dtype[Any]:
        code = self.arguments[0]
        if not isinstance(code, str) or not _DTYPE_CODE.fullmatch(code):
            raise InvalidArrayError(
                f"holds {'objects' if code == 'O8' else 'no numbers'}, not numbers"
            )
        order = self.state[1] if isinstance(self.state, tuple) and len(self.state) > 1 else "="
        if order not in ("<", ">"):
            return np.dtype(code)
        return np.dtype(f"{order}{code}")


class _Array(PickledObject):
    """Placeholder of a numpy array; its state is (version, shape, dtype, is Fortran order,
    bytes).
    """

    def dense(self) -> AnyArray:
        _, shape, kind, columns_first, data = self.state
        return _array_from_bytes(data, kind, _shape(shape), "F" if columns_first else "C")


class _FromBuffer(PickledObject):
    """Placeholder of a numpy array in pickle protocol 5.

    Its arguments are bytes, dtype, shape, order, and the order of the axes if they lie in memory in
    another one.
    """

    def dense(self) -> AnyArray:
        data, kind, shape, order, *axes = self.arguments
        stored = _array_from_bytes(data, kind, _shape(shape), "F" if order == "F" else "C")
        return stored.transpose(*axes) if axes else stored


class _JoblibArray(PickledObject):
    """Placeholder of an array by joblib, whose bytes follow its state in the file."""

    data = b""

    def read(self, file: Any) -> None:
        """Read the bytes of the array."""
        if self.part("numpy_array_alignment_bytes") is not None:
            file.read(file.read(1)[0])
        kind = self.part("dtype")
        shape = _shape(self.part("shape"))
        size = prod(shape) * kind.to_dtype().itemsize if isinstance(kind, _DType) else 0
        if size > _MAX_FILE_BYTES:
            raise InvalidArrayError("is an array that is larger than a file")
        self.data = file.read(size)

    def dense(self) -> AnyArray:
        return _array_from_bytes(
            self.data, self.part("dtype"), _shape(self.part("shape")), self.part("order")
        )


class _Dict(dict[Any, Any]):
    """Dictionary in place of a ``defaultdict``, whose factory is left out."""

    def __init__(self, *_: Any) -> None:
        super().__init__()


class _Scalar(PickledObject):
    """Placeholder of a numpy scalar; its arguments are dtype and bytes."""

    def dense(self) -> AnyArray:
        kind, data = self.arguments
        return _array_from_bytes(data, kind, (), "C")


class _Sparse(PickledObject):
    """Placeholder of a scipy sparse matrix, compressed by column."""

    by_column = True

    def dense(self) -> AnyArray:
        from scipy.sparse import csc_matrix, csr_matrix

        shape = _shape(self.part("shape") if self.part("_shape") is None else self.part("_shape"))
        data, indices, ends = (as_array(self.part(name)) for name in ("data", "indices", "indptr"))
        if (
            data.dtype.kind not in "fiu"
            or indices.dtype.kind not in "iu"
            or ends.dtype.kind not in "iu"
        ):
            raise InvalidArrayError(
                f"is a sparse matrix of {data.dtype} by {indices.dtype}, not of numbers"
            )
        if prod(shape) > _MAX_MATRIX_SIZE:
            raise InvalidArrayError(
                f"is a sparse matrix of shape {shape}, larger than any body model's"
            )
        parts = data.astype(data.dtype.newbyteorder("=")), indices, ends
        matrix = (
            csc_matrix(parts, shape=shape) if self.by_column else csr_matrix(parts, shape=shape)
        )
        # toarray would write outside of the array for a wrong index
        matrix.check_format(full_check=True)
        full: AnyArray = matrix.toarray()
        return full


class _SparseByRow(_Sparse):
    by_column = False


class _Chumpy(PickledObject):
    """Placeholder of a chumpy array: its numbers, or a selection of the numbers of another one."""

    def dense(self) -> AnyArray:
        if self.part("x") is not None:
            return as_array(self.part("x"))
        if self.part("a") is None or self.part("idxs") is None:
            raise InvalidArrayError("is an expression for chumpy to compute, not numbers")
        chosen: AnyArray = as_array(self.part("a")).ravel()[as_array(self.part("idxs"))]
        shape = self.part("preferred_shape")
        return chosen if shape is None else chosen.reshape(_shape(shape))


class _Reconstructed(PickledObject):
    """Placeholder of the functions that create arrays and old-style classes; all classes are
    placeholders.
    """

    def __new__(cls, kind: Any = None, *_: Any) -> Any:
        return kind()


class _Encoded(PickledObject):
    """Placeholder of ``_codecs.encode``, by which Python 3 writes bytes for Python 2; accepts
    latin1 only.
    """

    def __new__(cls, text: Any = "", encoding: Any = "latin1", *_: Any) -> Any:
        if not isinstance(text, str) or encoding not in ("latin1", "latin-1"):
            # Never by ``repr``, which can be endless.
            name = encoding if isinstance(encoding, str) else f"a {type(encoding).__name__}"
            raise UnsafePickleError(f"bytes in {escape_unprintable(name)}")
        return text.encode("latin1")


_PLACEHOLDERS: dict[tuple[str, str], type[PickledObject | _Dict]] = {
    ("joblib.numpy_pickle", "NumpyArrayWrapper"): _JoblibArray,
    ("collections", "defaultdict"): _Dict,
    ("builtins", "dict"): _Dict,
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


class _Unpickler(pickle._Unpickler):
    """Unpickler that creates placeholders only.

    The version in C allocates memory for any index in a file.
    """

    dispatch: ClassVar = dict(pickle._Unpickler.dispatch)

    def __init__(self, file: io.BytesIO, **options: Any) -> None:
        super().__init__(file, **options)
        self._file = file

    def load_build(self) -> None:
        """Set a state, and read the array that joblib writes behind it."""
        super().load_build()  # type: ignore[misc]  # not in typeshed, as all below
        if isinstance(self.stack[-1], _JoblibArray):  # type: ignore[attr-defined]
            self.stack[-1].read(self._file)  # type: ignore[attr-defined]

    dispatch[pickle.BUILD[0]] = load_build  # type: ignore[assignment]

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


def _array_from_bytes(data: Any, kind: Any, shape: tuple[int, ...], order: Any) -> AnyArray:
    """Return the array of bytes in a dtype and shape; text stands for bytes of Python 2."""
    if not isinstance(kind, _DType):
        raise InvalidArrayError("is an array without a type")
    content = data.encode("latin1") if isinstance(data, str) else data
    if not prod(shape):
        return np.empty(shape, kind.to_dtype())
    return np.frombuffer(content, kind.to_dtype()).reshape(shape, order=order)


def _shape(stored_shape: Any) -> tuple[int, ...]:
    """Return the axis lengths of an array, which can be placeholders of numpy scalars."""
    return tuple(
        int(as_array(n)) if isinstance(n, _Scalar) else operator.index(n) for n in stored_shape
    )
