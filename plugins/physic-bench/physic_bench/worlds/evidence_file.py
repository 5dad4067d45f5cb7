"""Reading and writing of evidence (the output of all estimators) in one file."""

from __future__ import annotations

from dataclasses import is_dataclass
from pathlib import Path

from physic_core import types
from physic_core.files.archive import DamagedFileError, join_arrays, read_archive, split_arrays, write_archive
from physic_core.pipeline.estimate import Estimates

_CLASSES: tuple[type, ...] = (
    Estimates,
    *(kind for kind in vars(types).values() if isinstance(kind, type) and is_dataclass(kind)),
)


def save_evidence(path: Path, evidence: Estimates) -> None:
    """Write evidence to a file atomically.

    Raises:
        OutputError: the folder cannot be written.
    """
    write_archive(path, *split_arrays(evidence))


def load_evidence(path: Path) -> Estimates | None:
    """Read evidence from a file; None if it is missing or damaged."""
    try:
        found = join_arrays(*read_archive(path), _CLASSES)
    except (OSError, DamagedFileError, KeyError, TypeError):
        return None
    return found if isinstance(found, Estimates) else None
