"""Reading and writing of evidence (the output of all estimators) in one file."""

from __future__ import annotations

from pathlib import Path

from physic_core.engine.joint.problem import OtherView
from physic_core.engine.stance import Stance
from physic_core.files.plain import DamagedFileError, read_value, write_value
from physic_core.geometry.floor import FloorSearch
from physic_core.pipeline.estimate import Estimates


def save_evidence(path: Path, evidence: Estimates) -> None:
    """Write evidence to a file atomically.

    Raises:
        OutputError: the folder cannot be written.
    """
    write_value(path, evidence)


def load_evidence(path: Path) -> Estimates | None:
    """Read evidence from a file; None if it is missing or damaged."""
    try:
        found: Estimates = read_value(path, [Estimates, OtherView, FloorSearch, Stance])
    except (OSError, DamagedFileError):
        return None
    return found
