"""What an exporter returns, and what an export returns to its caller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True)
class ExportedFiles:
    """Files of one export, which an exporter returns.

    Attributes:
        files: file name -> content.
        notes: sentences for the user.
    """

    files: dict[str, bytes]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Exported:
    """Result of an export.

    Attributes:
        files: paths of the written files.
        notes: sentences about frame, fit errors and what was omitted.
    """

    files: tuple[Path, ...]
    notes: tuple[str, ...]
