"""Compare files with the size and the SHA-256 in a manifest."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from physic_core.weights.manifest import WeightFile

__all__ = ["difference", "git_hash", "sha256_of"]

_CHUNK = 1 << 20


def difference(path: Path, file: WeightFile) -> str:
    """Describe how a file differs from its manifest entry; "" if it matches."""
    size = path.stat().st_size
    if file.bytes is not None and size != file.bytes:
        return f"it has {size} bytes instead of {file.bytes}"
    if file.sha256 is not None and (found := sha256_of(path)) != file.sha256:
        return f"its SHA-256 is {found} instead of {file.sha256}"
    return ""


def sha256_of(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits."""
    return _digest(path, hashlib.sha256())


def git_hash(path: Path) -> str:
    """The git blob hash of a file, by which Hugging Face identifies small files."""
    return _digest(path, hashlib.sha1(f"blob {path.stat().st_size}\0".encode(), usedforsecurity=False))


def _digest(path: Path, digest: Any) -> str:
    with path.open("rb") as file:
        while piece := file.read(_CHUNK):
            digest.update(piece)
    return str(digest.hexdigest())
