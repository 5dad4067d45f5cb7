"""Compare weight files with the size and the SHA-256 in a manifest."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import BinaryIO

from physic_core.weights.manifest import WeightFile

__all__ = ["describe_mismatch", "git_blob_hash", "sha256_of", "sha256_of_open"]


def describe_mismatch(path: Path, file: WeightFile) -> str:
    """Describe how the size or SHA-256 of a file differs from its manifest; "" if they match."""
    size = path.stat().st_size
    if file.bytes is not None and size != file.bytes:
        return f"it has {size} bytes instead of {file.bytes}"
    if file.sha256 is not None and (found := sha256_of(path)) != file.sha256:
        return f"its SHA-256 is {found} instead of {file.sha256}"
    return ""


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits."""
    with path.open("rb") as file:
        return sha256_of_open(file)


def sha256_of_open(file: BinaryIO) -> str:
    """Return the SHA-256 of an open file, from its place on, as hexadecimal digits."""
    return hashlib.file_digest(file, "sha256").hexdigest()


def git_blob_hash(path: Path) -> str:
    """Return the git blob hash of a file; Hugging Face uses it as ETag of small files."""
    digest = hashlib.sha1(f"blob {path.stat().st_size}\0".encode(), usedforsecurity=False)
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: digest).hexdigest()
