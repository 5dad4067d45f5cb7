"""Digests of backend inputs: equal content, equal digest."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    AnyArray = NDArray[Any]

__all__ = ["Digester"]

_BYTES = 20


class Digester:
    """Computes digests; each array is read only once, since several backends get the same photo."""

    def __init__(self) -> None:
        self._arrays: dict[int, tuple[AnyArray, bytes]] = {}

    def digest(self, *things: object) -> str:
        """Hexadecimal digest of arrays, numbers, strings, tuples, lists, mappings and dataclasses of these.

        Arrays must not be modified while this object is in use.

        Raises:
            TypeError: a value has another type.
        """
        whole = hashlib.blake2b(digest_size=_BYTES)
        self._feed(whole, things)
        return whole.hexdigest()

    def _feed(self, whole: Any, thing: Any) -> None:
        """Hash a value after its type and length, so that different values never give the same bytes."""
        if isinstance(thing, np.ndarray):
            whole.update(f"array {thing.dtype.str} {thing.shape};".encode() + self._array(thing))
        elif thing is None or isinstance(thing, bool | int | float | np.generic):
            text = repr(thing)
            whole.update(f"number {len(text)} {text};".encode())
        elif isinstance(thing, str):
            encoded = thing.encode("utf-8", "surrogatepass")
            whole.update(f"text {len(encoded)};".encode() + encoded)
        elif is_dataclass(thing) and not isinstance(thing, type):
            parts = {field.name: getattr(thing, field.name) for field in fields(thing) if field.init}
            whole.update(f"dataclass {type(thing).__name__};".encode())
            self._feed(whole, parts)
        elif isinstance(thing, Mapping):
            whole.update(f"mapping {len(thing)};".encode())
            for key in sorted(thing):
                self._feed(whole, key)
                self._feed(whole, thing[key])
        elif isinstance(thing, tuple | list):
            whole.update(f"sequence {len(thing)};".encode())
            for item in thing:
                self._feed(whole, item)
        else:
            raise TypeError(f"{type(thing).__name__} has no digest.")

    def _array(self, array: AnyArray) -> bytes:
        known = self._arrays.get(id(array))
        if known is not None:
            return known[1]
        if array.dtype.hasobject:
            raise TypeError("an array of Python objects has no digest.")
        found = hashlib.blake2b(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data, digest_size=_BYTES)
        # Kept with it, so that its id stays its own.
        self._arrays[id(array)] = (array, found.digest())
        return found.digest()
