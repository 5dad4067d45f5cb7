"""Which attributes of an object, and of the objects that it holds, were replaced."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import FunctionType, MethodType, ModuleType
from typing import Any

_MAX_DEPTH = 4
_MAX_VALUES = 5000
_PLAIN = (type(None), bool, int, float, complex, str, bytes)


def attribute_values(thing: object) -> dict[str, Any]:
    """Return the objects that an object holds by their path, such as "_networks['depth'].session".

    Dictionaries, lists and tuples are opened, and instances with attributes, four levels deep.
    """
    found: dict[str, Any] = {}
    for path, value in _walk(thing, "", 0, set()):
        found[path] = value  # kept alive, so that no new object gets its address
        if len(found) >= _MAX_VALUES:
            break
    return found


def replaced_attributes(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    """Return the paths whose object is another one than before; numbers and texts are compared by
    value.
    """
    return [path for path, value in before.items() if not _same(value, after.get(path))]


def _same(old: Any, new: Any) -> bool:
    if isinstance(old, _PLAIN):
        return type(old) is type(new) and bool(old == new or old != old)
    return (isinstance(old, tuple) and isinstance(new, tuple)) or old is new


def _walk(thing: object, path: str, depth: int, seen: set[int]) -> Iterator[tuple[str, Any]]:
    if depth > _MAX_DEPTH or isinstance(
        thing, (*_PLAIN, type, ModuleType, FunctionType, MethodType)
    ):
        return
    if id(thing) in seen:
        return
    seen.add(id(thing))
    for step, value in _parts(thing):
        yield f"{path}{step}".lstrip("."), value
        yield from _walk(value, f"{path}{step}", depth + 1, seen)


def _parts(thing: object) -> Iterator[tuple[str, Any]]:
    if isinstance(thing, Mapping):
        # Keys of other types have no stable text.
        yield from (
            (f"[{key!r}]" if isinstance(key, str) else f"[{i}]", v)
            for i, (key, v) in enumerate(thing.items())
        )
    elif isinstance(thing, list | tuple):
        yield from ((f"[{i}]", value) for i, value in enumerate(thing))
    else:
        yield from (
            ((f".{name}", value) for name, value in vars(thing).items())
            if hasattr(thing, "__dict__")
            else ()
        )
