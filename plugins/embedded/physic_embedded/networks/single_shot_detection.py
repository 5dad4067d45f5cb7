"""Decode MediaPipe's single-shot detectors: anchors, boxes with keypoints, merging of overlapping
detections.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.backends.people import box_iou
from physic_networks.people import sigmoid

if TYPE_CHECKING:
    from physic_core.types import FloatArray


OVERLAP = 0.3
"""Boxes with a larger intersection over union are of one thing."""


@dataclass(frozen=True)
class BoxDetection:
    """Detected box with keypoints and score.

    Attributes:
        box: (4,) x0 y0 x1 y1.
        keypoints: (K, 2), in the box's units.
        score: in [0, 1].
    """

    box: FloatArray
    keypoints: FloatArray
    score: float


def anchor_centers(size: int, layers: tuple[tuple[int, int], ...]) -> FloatArray:
    """Return the anchor centres (A, 2), x y in [0, 1], of a ``size`` px network.

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


def decode_detections(
    raw: FloatArray, logits: FloatArray, anchors: FloatArray, size: int, threshold: float
) -> list[BoxDetection]:
    """Decode network output to detections in pixel-edge coordinates of the ``size`` px input, best
    first.

    Detections whose boxes overlap are averaged with their scores as weights, as in MediaPipe.

    Args:
        raw: (A, 4 + 2 K) box centre, box size and K keypoints, px relative to the anchor.
        logits: (A,) score logits.
        anchors: (A, 2) of :func:`anchor_centers`.
        size: side of the network's input, px.
        threshold: detections with a lower score are dropped.
    """
    scores = sigmoid(logits)
    kept_rows = np.flatnonzero(scores >= threshold)
    kept_rows = kept_rows[np.argsort(-scores[kept_rows], kind="stable")]
    anchor = anchors[kept_rows] * size
    values = raw[kept_rows].astype(float)
    center = values[:, :2] + anchor
    half = values[:, 2:4] / 2
    boxes = np.concatenate([center - half, center + half], axis=1)
    points = values[:, 4:].reshape(len(kept_rows), raw.shape[1] // 2 - 2, 2) + anchor[:, None]
    scores = scores[kept_rows]
    left = np.ones(len(kept_rows), bool)
    detections = []
    for i in range(len(kept_rows)):
        if not left[i]:
            continue
        group = left & (box_iou(boxes[i : i + 1], boxes)[0] > OVERLAP)
        group[i] = True
        left &= ~group
        weight = scores[group] / scores[group].sum()
        detections.append(
            BoxDetection(
                weight @ boxes[group], np.tensordot(weight, points[group], 1), float(scores[i])
            )
        )
    return detections
