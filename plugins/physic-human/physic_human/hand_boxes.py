"""Compute boxes of hands from the keypoints of people, without a hand detector.

Whole-body skeletons have 21 points per hand, and the box is their bounding box. Other skeletons have a wrist and an
elbow. There the hand is assumed beyond the wrist, in the direction of the forearm, with three quarters of its length.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.types.skeletons import SIDES, is_finger

if TYPE_CHECKING:
    from collections.abc import Mapping

    from physic_core.types import BoolArray, FloatArray, IntArray, Keypoints

_HAND_POINTS = 21
_BEYOND, _LENGTH, _UPPER_ARM = 0.33, 0.75, 0.9
"""Distance of the hand centre from the wrist, and side of its box, in forearm lengths; and the minimum forearm length
in upper-arm lengths, since a forearm that points at the camera looks short.
"""
_EDGE = 0.5
"""Offset from pixel-centre coordinates to half-open box coordinates, px."""


@dataclass(frozen=True)
class HandBoxes:
    """Boxes of M hands of N people, sorted by person, left before right.

    Attributes:
        person: (M,) row of the person.
        right: (M,) whether it is the right hand.
        boxes: (M, 4) x0 y0 x1 y1 px, half open, tight around the hand.
        confidence: (M,) in [0, 1], of the keypoints that the box is computed from.
    """

    person: IntArray
    right: BoolArray
    boxes: FloatArray
    confidence: FloatArray

    def __len__(self) -> int:
        return len(self.person)


def hand_boxes(keypoints: Keypoints, *, least_confidence: float = 0.5, least_size_px: float = 16.0) -> HandBoxes:
    """Compute the boxes of the visible hands from keypoints.

    Args:
        keypoints: of N people, in any skeleton; one without arms gives no hands.
        least_confidence: minimum of the mean over the 21 points of a hand, or of the lower one of wrist and elbow.
        least_size_px: minimum of the longer side, px; smaller hands are skipped.
    """
    found: list[tuple[int, bool, FloatArray, float]] = []
    row = {name: i for i, name in enumerate(keypoints.joint_set.names)}
    for person, (points, sure) in enumerate(zip(keypoints.points, keypoints.confidence, strict=True)):
        for side in SIDES:
            hand = _from_points(points, sure, row, side) or _from_arm(points, sure, row, side)
            if hand is None:
                continue
            box, confidence = hand
            if confidence >= least_confidence and float((box[2:] - box[:2]).max()) >= least_size_px:
                found.append((person, side == "right", box + _EDGE, min(confidence, 1.0)))
    return HandBoxes(
        np.array([f[0] for f in found], np.int64),
        np.array([f[1] for f in found], bool),
        np.array([f[2] for f in found], np.float64).reshape(-1, 4),
        np.array([f[3] for f in found], np.float64),
    )


def _from_points(
    points: FloatArray, sure: FloatArray, row: Mapping[str, int], side: str
) -> tuple[FloatArray, float] | None:
    """Return the bounding box of 21 hand keypoints and their mean confidence; None for fewer keypoints."""
    of_side = {name: i for name, i in row.items() if name.startswith(side)}
    hand = [i for name, i in of_side.items() if is_finger(name) or name == f"{side}_hand_root"]
    if len(hand) < _HAND_POINTS:
        return None
    xy = points[hand].astype(np.float64)
    return np.concatenate([xy.min(axis=0), xy.max(axis=0)]), float(sure[hand].mean())


def _from_arm(
    points: FloatArray, sure: FloatArray, row: Mapping[str, int], side: str
) -> tuple[FloatArray, float] | None:
    """Return the corners of a square box beyond the wrist, and the lower confidence of wrist and elbow."""
    names = [f"{side}_{joint}" for joint in ("shoulder", "elbow", "wrist")]
    if not all(name in row for name in names):
        return None
    shoulder, elbow, wrist = (row[name] for name in names)
    place = points[wrist].astype(np.float64)
    along = place - points[elbow]
    forearm = float(np.linalg.norm(along))
    if sure[shoulder] > 0:
        forearm = max(forearm, _UPPER_ARM * float(np.linalg.norm(points[elbow] - points[shoulder])))
    middle, half = place + _BEYOND * along, _LENGTH * forearm / 2
    return np.concatenate([middle - half, middle + half]), float(min(sure[wrist], sure[elbow]))
