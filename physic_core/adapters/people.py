"""Convert the masks of networks to the output of a Segmenter."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.types import People
from physic_core.types.per_person import select_people

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray, Keypoints


def people_from_masks(
    masks: Iterable[NDArray[Any]],
    boxes: FloatArray | None,
    scores: FloatArray,
    floor: BoolArray | None = None,
    *,
    size: tuple[int, int],
    keypoints: Keypoints | None = None,
    reach: float = 0.25,
    smallest: int = 1,
) -> People:
    """Build People from masks: disjoint masks with tight boxes, best score first.

    A pixel of several masks goes to the largest logit, or for bool masks to the best score. People with fewer than
    ``smallest`` pixels are removed. Pixels of people are removed from the floor.

    Args:
        masks: N of (H, W), logits (above 0 inside) or bool; processed one by one, so a generator saves memory.
        boxes: (N, 4) x0 y0 x1 y1 px of the detector, which limit the masks; None for no limit.
        scores: (N,) in [0, 1].
        floor: (H, W) bool or None.
        size: H and W, px.
        keypoints: N rows, or None.
        reach: how far a mask may extend outside its box, in widths and heights of the box.
        smallest: px.
    """
    scores = np.clip(np.asarray(scores, np.float64), 0.0, 1.0).reshape(-1)
    owner = np.full(size, -1, np.int16)
    strongest = np.zeros(size, np.float32)
    best = np.full(size, -1.0)
    for i, mask in enumerate(masks):
        # True counts as a logit of 1.
        strength: FloatArray = np.nan_to_num(np.asarray(mask, np.float32), nan=0.0)
        claim: BoolArray = np.asarray(strength > 0)
        if boxes is not None:
            claim &= _within(boxes[i], reach, size)
        # For equal logits, as of bool masks, the better score wins.
        wins = claim & ((strength > strongest) | ((strength == strongest) & (scores[i] > best)))
        owner[wins] = i
        best[wins] = scores[i]
        strongest[wins] = strength[wins]
    area = np.bincount(owner[owner >= 0].ravel(), minlength=len(scores))
    rows = np.array([i for i in np.argsort(-scores, kind="stable") if area[i] >= max(1, smallest)], int)
    final = np.stack([owner == i for i in rows]) if len(rows) else np.zeros((0, *size), bool)
    if keypoints is not None:
        keypoints = select_people(keypoints, rows)
    if floor is not None:
        floor = floor & ~final.any(axis=0)
    return People(final, boxes_from_masks(final), scores[rows], floor, keypoints)


def boxes_from_masks(masks: BoolArray) -> FloatArray:
    """Return the bounding boxes (N, 4) x0 y0 x1 y1 px of masks (N, H, W), half open; zeros for an empty mask."""
    boxes: FloatArray = np.zeros((len(masks), 4))
    for i, mask in enumerate(masks):
        columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
        if len(rows):
            boxes[i] = columns[0], rows[0], columns[-1] + 1, rows[-1] + 1
    return boxes


def mask_nms(masks: BoolArray, scores: FloatArray, overlap: float = 0.8) -> NDArray[np.intp]:
    """Return the indices of masks without duplicates of the same person, best score first.

    Two masks are of the same person if their intersection over union is more than ``overlap``.

    Args:
        masks: (N, H, W) bool, at any resolution.
        scores: (N,).
        overlap: in [0, 1].
    """
    flat = masks.reshape(len(masks), -1).astype(np.float32)
    shared = flat @ flat.T
    area = shared.diagonal()
    iou = shared / np.maximum(area[:, None] + area[None] - shared, 1.0)
    kept: list[int] = []
    for i in np.argsort(-scores, kind="stable"):
        if all(iou[i, k] <= overlap for k in kept):
            kept.append(int(i))
    return np.array(kept, np.intp)


def _within(box: FloatArray, reach: float, size: tuple[int, int]) -> BoolArray:
    """Return a mask (H, W) of the pixels of a box enlarged by ``reach`` of its size on each side."""
    grow = reach * (box[2:] - box[:2])
    x0, y0 = np.maximum(np.floor(box[:2] - grow), 0).astype(int)
    x1, y1 = np.ceil(box[2:] + grow).astype(int)
    inside = np.zeros(size, bool)
    inside[y0 : max(y1, 0), x0 : max(x1, 0)] = True
    return inside
