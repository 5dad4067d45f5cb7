"""Masks as uncompressed COCO run lengths, and as polygons."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray

__all__ = ["polygons", "run_lengths"]


def run_lengths(mask: BoolArray) -> dict[str, Any]:
    """Return COCO's uncompressed RLE of a mask (H, W): lengths of runs of 0 and 1 in turn, column by column."""
    flat = np.concatenate([[False], mask.T.reshape(-1)])
    starts = np.flatnonzero(flat[1:] != flat[:-1])
    return {"size": list(mask.shape), "counts": np.diff([0, *starts.tolist(), mask.size]).tolist()}


def polygons(mask: BoolArray) -> list[NDArray[np.float64]]:
    """Return the outlines (n, 2) of the pieces of a mask, px; pieces of fewer than three points are left out."""
    import cv2

    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return [outline[:, 0].astype(np.float64) for outline in outlines if len(outline) >= 3]
