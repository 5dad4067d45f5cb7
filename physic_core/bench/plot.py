"""The ablation as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_core.bench.results import Results

__all__ = ["draw"]


def draw(results: Results, path: Path) -> Path:
    """x"""
    raise ModuleNotFoundError("x", name="matplotlib")
