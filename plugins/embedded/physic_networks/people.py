"""Convert the boxes and masks of networks to the output of a Segmenter: duplicates and disjoint
masks.

Boxes are those of :mod:`physic_core.backends.people`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.backends.people import box_iou, boxes_from_masks, mask_iou
from physic_core.types import People, select_people

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from physic_core.types import AnyArray, BoolArray, FloatArray, Keypoints


@dataclass(frozen=True)
class Detections:
    """Detected boxes of people, best score first.

    Attributes:
        boxes: (N, 4) x0 y0 x1 y1 px of the photo, half open, inside it.
        scores: (N,) in [0, 1].
        keypoints: N rows if the detector also detects joints, else None.
    """

    boxes: FloatArray
    scores: FloatArray
    keypoints: Keypoints | None = None

    def __len__(self) -> int:
        return len(self.boxes)

    def __getitem__(self, rows: Any) -> Detections:
        """Select rows by slice, indices or mask."""
        chosen = np.arange(len(self))[rows]
        joints = None if self.keypoints is None else select_people(self.keypoints, chosen)
        return Detections(self.boxes[chosen], self.scores[chosen], joints)


def xyxy_from_cxcywh(boxes: FloatArray) -> FloatArray:
    """Convert boxes (..., 4) from centre x, centre y, width, height to x0 y0 x1 y1."""
    centre = boxes[..., :2]
    half = boxes[..., 2:] / 2
    return np.concatenate([centre - half, centre + half], axis=-1)


def sigmoid(logits: FloatArray) -> FloatArray:
    """Return 1 / (1 + exp(-x)) of logits, clipped to avoid overflow."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(logits, -60.0, 60.0))))


def nms(boxes: FloatArray, scores: FloatArray, overlap: float) -> NDArray[np.intp]:
    """Return the indices of boxes to keep by non-maximum suppression, best score first.

    A box is removed if its intersection over union with a kept box of a better score is more than
    ``overlap``.

    Args:
        boxes: (N, 4) x0 y0 x1 y1.
        scores: (N,).
        overlap: in [0, 1]; 0.45 for boxes of people, a larger value removes fewer people of a
            crowd.
    """
    left = np.argsort(-scores, kind="stable")
    kept_rows = []
    while len(left):
        best = left[0]
        left = left[1:]
        kept_rows.append(best)
        left = left[box_iou(boxes[best : best + 1], boxes[left])[0] <= overlap]
    return np.array(kept_rows, np.intp)


def clip_boxes(boxes: FloatArray, height: int, width: int) -> tuple[FloatArray, BoolArray]:
    """Clip boxes to the photo, and return which clipped boxes are finite and at least one pixel
    wide and high.

    Args:
        boxes: (N, 4) x0 y0 x1 y1 px; boxes with non-finite coordinates are not kept.
        height: of the photo, px.
        width: of the photo, px.

    Returns:
        (N, 4) clipped boxes, and (N,) bool, which to keep.
    """
    finite: BoolArray = np.asarray(np.isfinite(boxes).all(axis=1))
    inside: FloatArray = np.clip(
        np.where(finite[:, None], boxes, 0.0), 0.0, [width, height, width, height]
    )
    large: BoolArray = np.asarray((inside[:, 2:] - inside[:, :2] >= 1).all(axis=1))
    return inside, finite & large


def people_from_masks(
    masks: Iterable[AnyArray],
    boxes: FloatArray | None,
    scores: FloatArray,
    floor: BoolArray | None = None,
    *,
    size: tuple[int, int],
    keypoints: Keypoints | None = None,
) -> People:
    """Build People from masks: disjoint masks with tight boxes, best score first.

    A pixel of several masks goes to the largest logit, or for bool masks to the best score. People
    without a pixel are removed. Pixels of people are removed from the floor.

    Args:
        masks: N of (H, W), logits (above 0 inside) or bool; processed one by one, so a generator
            saves memory.
        boxes: (N, 4) x0 y0 x1 y1 px of the detector, which limit the masks; None for no limit.
        scores: (N,) in [0, 1].
        floor: (H, W) bool or None.
        size: H and W, px.
        keypoints: N rows, or None.
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
            claim &= _mask_of_enlarged_box(boxes[i], size)
        # For equal logits, as of bool masks, the better score wins.
        wins = claim & ((strength > strongest) | ((strength == strongest) & (scores[i] > best)))
        owner[wins] = i
        best[wins] = scores[i]
        strongest[wins] = strength[wins]
    area = np.bincount(owner[owner >= 0].ravel(), minlength=len(scores))
    rows = np.array([i for i in np.argsort(-scores, kind="stable") if area[i]], int)
    final = np.stack([owner == i for i in rows]) if len(rows) else np.zeros((0, *size), bool)
    if keypoints is not None:
        keypoints = select_people(keypoints, rows)
    if floor is not None:
        floor = floor & ~final.any(axis=0)
    return People(final, boxes_from_masks(final), scores[rows], floor, keypoints)


def mask_nms(masks: BoolArray, scores: FloatArray, overlap: float = 0.8) -> NDArray[np.intp]:
    """Return the indices of masks without duplicates of the same person, best score first.

    Two masks are of the same person if their intersection over union is more than ``overlap``.

    Args:
        masks: (N, H, W) bool, at any resolution.
        scores: (N,).
        overlap: in [0, 1].
    """
    iou = mask_iou(masks, masks)
    kept: list[int] = []
    for i in np.argsort(-scores, kind="stable"):
        if all(iou[i, k] <= overlap for k in kept):
            kept.append(int(i))
    return np.array(kept, np.intp)


_REACH = 0.25  # how far a mask may extend outside its box, in widths and heights of the box


def _mask_of_enlarged_box(box: FloatArray, size: tuple[int, int]) -> BoolArray:
    """Return a mask (H, W) of the pixels of a box enlarged on each side."""
    grow = _REACH * (box[2:] - box[:2])
    x0, y0 = np.maximum(np.floor(box[:2] - grow), 0).astype(int)
    x1, y1 = np.ceil(box[2:] + grow).astype(int)
    inside = np.zeros(size, bool)
    inside[y0 : max(y1, 0), x0 : max(x1, 0)] = True
    return inside
