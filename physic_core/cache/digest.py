"""Digests of backend inputs by content."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    AnyArray = NDArray[Any]

_BYTES = 20


class Digester:
    """Computes digests of values by content; each array is read only once."""

    def __init__(self) -> None:
        self._arrays: dict[int, tuple[AnyArray, bytes]] = {}

    def digest(self, *values: object) -> str:
        """Compute a hexadecimal digest of arrays, numbers, strings, tuples, lists, mappings and dataclasses.

        Arrays must not be modified while this object is in use.

        Raises:
            TypeError: a value has another type.
        """
        hasher = hashlib.blake2b(digest_size=_BYTES)
        self._feed(hasher, values)
        return hasher.hexdigest()

    def _feed(self, hasher: Any, value: Any) -> None:
        """Add type, length and content of a value to a hash."""
        if isinstance(value, np.ndarray):
            hasher.update(f"array {value.dtype.str} {value.shape};".encode() + self._array(value))
        elif value is None or isinstance(value, bool | int | float | np.generic):
            text = repr(value)
            hasher.update(f"number {len(text)} {text};".encode())
        elif isinstance(value, str):
            encoded = value.encode("utf-8", "surrogatepass")
            hasher.update(f"text {len(encoded)};".encode() + encoded)
        elif is_dataclass(value) and not isinstance(value, type):
            parts = {field.name: getattr(value, field.name) for field in fields(value) if field.init}
            hasher.update(f"dataclass {type(value).__name__};".encode())
            self._feed(hasher, parts)
        elif isinstance(value, Mapping):
            hasher.update(f"mapping {len(value)};".encode())
            for key in sorted(value):
                self._feed(hasher, key)
                self._feed(hasher, value[key])
        elif isinstance(value, tuple | list):
            hasher.update(f"sequence {len(value)};".encode())
            for item in value:
                self._feed(hasher, item)
        else:
            raise TypeError(f"{type(value).__name__} has no digest.")

    def _array(self, array: AnyArray) -> bytes:
        known = self._arrays.get(id(array))
        if known is not None:
            return known[1]
        if array.dtype.hasobject:
            raise TypeError("an array of Python objects has no digest.")
        found = hashlib.blake2b(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data, digest_size=_BYTES)
        # The array is stored too, so that no other array gets its id.
        self._arrays[id(array)] = (array, found.digest())
        return found.digest()
