"""Nested dataclasses as named arrays and a JSON document, and back, bit for bit and without pickles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["pack", "unpack"]


def pack(thing: object) -> tuple[dict[str, NDArray[Any]], Any]:
    """Apart: an array, or a dataclass of arrays, numbers, texts, tuples, mappings and dataclasses.

    Returns:
        Its arrays by path, and a JSON-ready document of the rest; lists come back as tuples.

    Raises:
        TypeError: it holds something else.
    """
    arrays: dict[str, NDArray[Any]] = {}

    def written(value: Any, path: str) -> Any:
        if isinstance(value, np.ndarray):
            arrays[path] = value
            return {"array": path}
        if isinstance(value, np.generic):
            return value.item()
        if is_dataclass(value) and not isinstance(value, type):
            parts = {f.name: written(getattr(value, f.name), f"{path}.{f.name}") for f in fields(value) if f.init}
            return {"class": type(value).__name__, "fields": parts}
        if isinstance(value, Mapping):
            return {"mapping": {key: written(item, f"{path}.{key}") for key, item in value.items()}}
        if isinstance(value, tuple | list):
            return {"tuple": [written(item, f"{path}.{i}") for i, item in enumerate(value)]}
        if value is None or isinstance(value, bool | int | float | str):
            return value
        raise TypeError(f"{path} is a {type(value).__name__}, which has no archive form.")

    return arrays, written(thing, type(thing).__name__)


def unpack(arrays: Mapping[str, NDArray[Any]], document: Any, classes: Iterable[type]) -> Any:
    """What ``pack`` took apart.

    Args:
        arrays: by path.
        document: as packed.
        classes: all that the document may name.

    Raises:
        KeyError, TypeError: the document is not of these classes.
    """
    known = {cls.__name__: cls for cls in classes}

    def read(value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        if "array" in value:
            return arrays[value["array"]]
        if "class" in value:
            return known[value["class"]](**{name: read(part) for name, part in value["fields"].items()})
        if "mapping" in value:
            return {name: read(part) for name, part in value["mapping"].items()}
        return tuple(read(part) for part in value["tuple"])

    return read(document)
