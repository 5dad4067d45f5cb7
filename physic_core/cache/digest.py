"""One number for what a backend is given: equal contents, equal number."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

__all__ = ["digest"]

_BYTES = 20


def digest(*things: object) -> str:
    """Hexadecimal digest of arrays, numbers, texts, tuples, lists, mappings and dataclasses of these.

    Raises:
        TypeError: there is something else among them.
    """
    whole = hashlib.blake2b(digest_size=_BYTES)
    for thing in things:
        _feed(whole, thing)
    return whole.hexdigest()


def _feed(whole: Any, thing: Any) -> None:
    """Feed a thing with its kind and its length before it, so that no two things give the same bytes."""
    if isinstance(thing, np.ndarray):
        if thing.dtype.hasobject:
            raise TypeError("an array of Python objects has no digest.")
        whole.update(f"array {thing.dtype.str} {thing.shape};".encode())
        whole.update(np.ascontiguousarray(thing).reshape(-1).view(np.uint8).data)
    elif thing is None or isinstance(thing, bool | int | float | np.generic):
        text = repr(thing)
        whole.update(f"number {len(text)} {text};".encode())
    elif isinstance(thing, str):
        text_bytes = thing.encode("utf-8", "surrogatepass")
        whole.update(f"text {len(text_bytes)};".encode() + text_bytes)
    elif is_dataclass(thing) and not isinstance(thing, type):
        names = [field.name for field in fields(thing) if field.init]
        whole.update(f"dataclass {type(thing).__name__} {len(names)};".encode())
        for name in names:
            _feed(whole, name)
            _feed(whole, getattr(thing, name))
    elif isinstance(thing, Mapping):
        whole.update(f"mapping {len(thing)};".encode())
        for key in sorted(thing):
            _feed(whole, key)
            _feed(whole, thing[key])
    elif isinstance(thing, tuple | list):
        whole.update(f"sequence {len(thing)};".encode())
        for item in thing:
            _feed(whole, item)
    else:
        raise TypeError(f"a {type(thing).__name__} has no digest.")
