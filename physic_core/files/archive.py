"""Store arrays, dataclasses and a JSON document in one npz file without pickle."""

from __future__ import annotations

import json
import math
import stat
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.files.atomic import atomic_write
from physic_core.files.npz import read_arrays, write_arrays
from physic_core.files.strict_json import from_json, parse_json, to_json

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Arrays = dict[str, NDArray[Any]]

_DOCUMENT = "document"


class DamagedFileError(Exception):
    """Raised if a file is damaged, or was not written by :func:`write_archive`."""


def split_arrays(value: object) -> tuple[Arrays, Any]:
    """Split a dataclass into arrays and a JSON document of all other values.

    Args:
        value: an array, or a dataclass of arrays, numbers, strings, tuples, mappings and dataclasses.

    Returns:
        The arrays by their path in the dataclass, and a JSON-ready document of the rest. Lists are restored as tuples.

    Raises:
        TypeError: the value contains an object of another class.
    """
    arrays: Arrays = {}

    def packed(value: Any, path: str) -> Any:
        if isinstance(value, np.ndarray):
            arrays[path] = value
            return {"array": path}
        if isinstance(value, np.generic):
            return packed(value.item(), path)
        if is_dataclass(value) and not isinstance(value, type):
            parts = {f.name: packed(getattr(value, f.name), f"{path}.{f.name}") for f in fields(value) if f.init}
            return {"class": type(value).__name__, "fields": parts}
        if isinstance(value, Mapping):
            return {"mapping": {key: packed(item, f"{path}.{key}") for key, item in value.items()}}
        if isinstance(value, tuple | list):
            return {"tuple": [packed(item, f"{path}.{i}") for i, item in enumerate(value)]}
        if isinstance(value, float) and not math.isfinite(value):
            return {"number": to_json(value)}
        if value is None or isinstance(value, bool | int | float | str):
            return value
        raise TypeError(f"{path} is a {type(value).__name__}, which cannot be stored.")

    return arrays, packed(value, type(value).__name__)


def join_arrays(arrays: Mapping[str, NDArray[Any]], document: Any, classes: Iterable[type]) -> Any:
    """Restore a value that :func:`split_arrays` has split into arrays and a JSON document.

    Args:
        arrays: by path.
        document: as returned by :func:`split_arrays`.
        classes: every dataclass that the document may name.

    Raises:
        KeyError, TypeError: the document names another class, or does not fit its class.
    """
    known = {cls.__name__: cls for cls in classes}

    def restore(value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        if "array" in value:
            return arrays[value["array"]]
        if "class" in value:
            return known[value["class"]](**{name: restore(part) for name, part in value["fields"].items()})
        if "mapping" in value:
            return {name: restore(part) for name, part in value["mapping"].items()}
        if "number" in value:
            return from_json(value["number"])
        return tuple(restore(part) for part in value["tuple"])

    return restore(document)


def read_archive(path: Path) -> tuple[Arrays, Any]:
    """Read the arrays and the JSON document of an archive file, and verify all checksums.

    Raises:
        OSError: the file is missing or cannot be read.
        DamagedFileError: the file is damaged, or was not written by :func:`write_archive`.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise DamagedFileError("it is not a regular file")  # opening a pipe would block for ever
    with path.open("rb") as stream:
        try:
            arrays = read_arrays(stream)
            return arrays, parse_json(arrays.pop(_DOCUMENT).tobytes())
        except Exception as error:  # zipfile, zlib, numpy and json raise a dozen classes for flipped and missing bytes
            raise DamagedFileError(f"{type(error).__name__}: {error}") from error


def write_archive(path: Path, arrays: Mapping[str, NDArray[Any]], document: Any, *, stored: str = "") -> None:
    """Write arrays and a document to a file that only its owner can read, completely or not at all.

    Its folder is created if missing.

    A loss of power can damage the file, which :func:`read_archive` reports: it does not wait for the disk.

    Args:
        path: file to write.
        arrays: by name.
        document: JSON-ready.
        stored: kinds of dtype that are not compressed, see :func:`physic_core.files.npz.write_arrays`.

    Raises:
        OSError, OutputError: the disk is full, or the folder cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    text = np.frombuffer(json.dumps(document, allow_nan=False).encode(), np.uint8)
    with atomic_write(path.parent, durable=False) as temporary:
        temporary(path.name).touch(mode=0o600)
        write_arrays(temporary(path.name), {**arrays, _DOCUMENT: text}, stored=stored)
