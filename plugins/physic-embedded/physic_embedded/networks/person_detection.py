"""Decoding the single-shot detectors of MediaPipe: anchors, boxes with keypoints, merging of overlapping answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Float = NDArray[np.floating[Any]]

__all__ = ["Detection", "anchor_centers", "box_iou", "decode", "sigmoid"]


@dataclass(frozen=True)
class Detection:
    """One answer of a detector.

    Attributes:
        box: (4,) x0 y0 x1 y1.
        keypoints: (K, 2), in the box's units.
        score: in [0, 1].
    """

    box: Float
    keypoints: Float
    score: float


def sigmoid(x: Float) -> Float:
    """Logits to (0, 1); clipped where float32 would overflow."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(x, -60.0, 60.0))))


def anchor_centers(size: int, layers: tuple[tuple[int, int], ...]) -> Float:
    """(A, 2) anchor centres in [0, 1], x y, of a ``size`` px network.

    Args:
        size: side of the network's input, px.
        layers: (stride px, anchors per cell) in the order of the network's output.
    """
    out = []
    for stride, per_cell in layers:
        cells = size // stride
        y, x = np.mgrid[:cells, :cells]
        centers = np.stack([(x + 0.5) / cells, (y + 0.5) / cells], axis=-1).reshape(-1, 2)
        out.append(np.repeat(centers, per_cell, axis=0))
    return np.concatenate(out)


def box_iou(box: Float, boxes: Float) -> Float:
    """Intersection over union of one box (4,) with boxes (N, 4) -> (N,)."""
    sides = np.clip(np.minimum(box[2:], boxes[:, 2:]) - np.maximum(box[:2], boxes[:, :2]), 0.0, None)
    shared = sides.prod(axis=1)
    union = (box[2:] - box[:2]).prod() + (boxes[:, 2:] - boxes[:, :2]).prod(axis=1) - shared
    overlap: Float = shared / np.maximum(union, 1e-9)
    return overlap


def decode(
    raw: Float, logits: Float, anchors: Float, size: int, threshold: float, overlap: float = 0.3
) -> list[Detection]:
    """Network output -> detections in corner coordinates of the ``size`` px input, best first.

    Answers whose boxes overlap are averaged with their scores as weights, as MediaPipe does: the mean is steadier than
    the best one.

    Args:
        raw: (A, 4 + 2 K) box centre, box size and K keypoints, px relative to the anchor.
        logits: (A,) score logits.
        anchors: (A, 2) of :func:`anchor_centers`.
        size: side of the network's input, px.
        threshold: answers with a lower score are dropped.
        overlap: boxes with a larger intersection over union are one thing.
    """
    scores = sigmoid(logits)
    kept = np.flatnonzero(scores >= threshold)
    kept = kept[np.argsort(-scores[kept], kind="stable")]
    anchor = anchors[kept] * size
    values = raw[kept].astype(float)
    center, half = values[:, :2] + anchor, values[:, 2:4] / 2
    boxes = np.concatenate([center - half, center + half], axis=1)
    points = values[:, 4:].reshape(len(kept), raw.shape[1] // 2 - 2, 2) + anchor[:, None]
    scores = scores[kept]
    left = np.ones(len(kept), bool)
    found = []
    for i in range(len(kept)):
        if not left[i]:
            continue
        group = left & (box_iou(boxes[i], boxes) > overlap)
        group[i] = True
        left &= ~group
        weight = scores[group] / scores[group].sum()
        found.append(Detection(weight @ boxes[group], np.tensordot(weight, points[group], 1), float(scores[i])))
    return found
