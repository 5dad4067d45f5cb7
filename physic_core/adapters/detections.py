"""Boxes of detectors: conversion, overlap and non-maximum suppression.

Boxes are x0 y0 x1 y1 px, half open like a slice. Their coordinates are pixel edges, so resizing a photo multiplies
them. A point at a pixel centre has integer coordinates; as an edge coordinate it is half a pixel larger.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.types.per_person import select_people

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import FloatArray, Keypoints


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
    centre, half = boxes[..., :2], boxes[..., 2:] / 2
    corners: FloatArray = np.concatenate([centre - half, centre + half], axis=-1)
    return corners


def sigmoid(logits: FloatArray) -> FloatArray:
    """Return 1 / (1 + exp(-x)) of logits, clipped to avoid overflow."""
    probability: FloatArray = np.asarray(1.0 / (1.0 + np.exp(-np.clip(logits, -60.0, 60.0))))
    return probability


def box_iou(boxes: FloatArray, others: FloatArray) -> FloatArray:
    """Return the intersection over union (N, M) of (N, 4) and (M, 4) boxes; 0 for empty boxes."""
    low = np.maximum(boxes[:, None, :2], others[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], others[None, :, 2:])
    shared = np.clip(high - low, 0, None).prod(axis=-1)
    sizes = [np.clip(b[:, 2:] - b[:, :2], 0, None).prod(axis=-1) for b in (boxes, others)]
    iou: FloatArray = shared / np.maximum(sizes[0][:, None] + sizes[1][None] - shared, 1e-9)
    return iou


def nms(boxes: FloatArray, scores: FloatArray, overlap: float) -> NDArray[np.intp]:
    """Return the indices of boxes to keep by non-maximum suppression, best score first.

    A box is removed if its intersection over union with a kept box of a better score is more than ``overlap``.

    Args:
        boxes: (N, 4) x0 y0 x1 y1.
        scores: (N,).
        overlap: in [0, 1]; 0.45 for boxes of people, a larger value removes fewer people of a crowd.
    """
    left = np.argsort(-scores, kind="stable")
    kept = []
    while len(left):
        best, left = left[0], left[1:]
        kept.append(best)
        left = left[box_iou(boxes[best : best + 1], boxes[left])[0] <= overlap]
    return np.array(kept, np.intp)


def clip_boxes(
    boxes: FloatArray, height: int, width: int, smallest: float = 1.0
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Clip boxes to the photo, and return which clipped boxes are finite and at least ``smallest`` px wide and high.

    Args:
        boxes: (N, 4) x0 y0 x1 y1 px; boxes with non-finite coordinates are not kept.
        height: of the photo, px.
        width: of the photo, px.
        smallest: px.

    Returns:
        (N, 4) clipped boxes, and (N,) bool, which to keep.
    """
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(boxes).all(axis=1))
    inside: FloatArray = np.clip(np.where(finite[:, None], boxes, 0.0), 0.0, [width, height, width, height])
    large: NDArray[np.bool_] = np.asarray((inside[:, 2:] - inside[:, :2] >= smallest).all(axis=1))
    return inside, finite & large
