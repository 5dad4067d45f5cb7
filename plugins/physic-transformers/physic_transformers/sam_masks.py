"""Convert the mask logits of SAM 2 and SAM 3 to person masks and a floor mask."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.adapters.people import mask_nms, people_from_masks
from physic_core.adapters.pictures import resize_map

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray, People

__all__ = ["best_rows", "people_from_sam", "union_of_masks"]


def best_rows(scores: FloatArray, threshold: float, most: int) -> NDArray[np.intp]:
    """Return at most ``most`` rows with a score above the threshold, best first."""

    order = np.argsort(-scores, kind="stable")
    found: NDArray[np.intp] = order[scores[order] > threshold][:most]
    return found


def people_from_sam(
    logits: FloatArray,
    boxes: FloatArray,
    scores: FloatArray,
    floor: BoolArray | None,
    size: tuple[int, int],
    *,
    same: float,
) -> People:
    """Build people from masks (N, h, w), one mask per person, and remove duplicates.

    Args:
        logits: (N, h, w) over the whole photo, above 0 inside.
        boxes: (N, 4) x0 y0 x1 y1 px of the photo, of what they were asked with.
        scores: (N,) in [0, 1].
        floor: (H, W) or None.
        size: H and W of the photo.
        same: masks that share more of their union than this are one person, seen twice.
    """

    rows = mask_nms(logits > 0, scores, same) if len(logits) else np.zeros(0, np.intp)
    masks = (resize_map(logits[i], *size) for i in rows)
    return people_from_masks(masks, boxes[rows], scores[rows], floor, size=size)


def union_of_masks(logits: FloatArray, size: tuple[int, int]) -> BoolArray:
    """Return the union (H, W) at photo size of masks (N, h, w) given as logits."""

    found: BoolArray = np.zeros(size, bool)
    for one in logits:
        found |= resize_map(one, *size) > 0
    return found
