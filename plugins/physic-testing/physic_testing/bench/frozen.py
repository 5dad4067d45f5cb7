"""Evidence as one file of plain arrays, so that one look at a photo serves many runs of the engine.

Nothing in the file is code: arrays, and one JSON text that says how they make up the dataclasses.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core import types
from physic_core.files.atomic import replacing
from physic_core.pipeline.estimate import Evidence

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["load_evidence", "save_evidence"]

_KINDS: dict[str, type] = {
    kind.__name__: kind for kind in (Evidence, *vars(types).values()) if isinstance(kind, type) and is_dataclass(kind)
}
_LAYOUT = "layout"


def save_evidence(path: Path, evidence: Evidence) -> None:
    """Write to ``path``, whole or not at all.

    Raises:
        OutputError: the folder cannot be written.
    """
    arrays: dict[str, NDArray[Any]] = {}
    layout = json.dumps(_pack(evidence, arrays))
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path.parent) as temporary, temporary(path.name).open("wb") as file:
        np.savez_compressed(file, **{_LAYOUT: np.array(layout)}, **arrays)  # type: ignore[arg-type]


def load_evidence(path: Path) -> Evidence | None:
    """Read what :func:`save_evidence` wrote; None where there is no such file, or it is of no use."""
    try:
        # Opened here: NumPy leaves the file of a broken archive open.
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            found = _unpack(json.loads(str(file[_LAYOUT])), file)
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile, zlib.error, EOFError):
        return None
    return found if isinstance(found, Evidence) else None


def _pack(value: Any, arrays: dict[str, NDArray[Any]]) -> Any:
    if isinstance(value, np.ndarray):
        name = f"a{len(arrays)}"
        arrays[name] = value
        return {"array": name}
    if is_dataclass(value):
        return {
            "kind": type(value).__name__,
            "fields": {f.name: _pack(getattr(value, f.name), arrays) for f in fields(value)},
        }
    if isinstance(value, (tuple, list)):
        return {"tuple": [_pack(item, arrays) for item in value]}
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, (str, int, float, bool)):
        return value
    raise TypeError(f"evidence holds a {type(value).__name__}, which has no place in its file")


def _unpack(value: Any, arrays: Any) -> Any:
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return arrays[value["array"]]
    if "tuple" in value:
        return tuple(_unpack(item, arrays) for item in value["tuple"])
    return _KINDS[value["kind"]](**{name: _unpack(item, arrays) for name, item in value["fields"].items()})
