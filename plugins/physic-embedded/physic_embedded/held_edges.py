"""Find hands that may hold something: a straight edge, such as that of a bar or a table, leads to
the hand.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import People

    FloatArray = NDArray[np.floating]
    BoolArray = NDArray[np.bool_]

# Lengths are shares of the longer side of the person's box.
_PATCH = 0.3  # half side of the pixels around a hand that are searched
_MIN_LENGTH = 0.08  # of an edge
_MAX_GAP = 0.01  # in an edge
_MAX_ASIDE = 0.05  # from the hand to the line through the edge
# from the hand to the nearer end of the edge; hands and sleeves hide the edge itself
_MAX_AWAY = 0.2
_MAX_UNEVEN = 0.25  # between the heights of both hands; beyond, the lower one carries
_MIN_CONFIDENCE = 0.3  # of a wrist
_GROWTH_PX = 2  # of the people's masks: the outline of an arm is an edge too
_CANNY = (30, 90)  # thresholds of the gradient; bars are often as grey as what is behind them
_MIN_PX = 8  # of a patch


def hands_at_edges(image: NDArray[np.uint8], people: People) -> BoolArray:
    """Return which hands of N people are at a straight edge: (N, 2) bool, left and right.

    All are False for people without keypoints of wrists. Two hands at about the same height hold
    the same bar: an edge at one of them counts for both. If one hand is far above the other, only
    the lower one counts.
    """
    found = np.zeros((len(people), 2), bool)
    keypoints = people.keypoints
    if keypoints is None or not len(people):
        return found
    row = {name: j for j, name in enumerate(keypoints.joint_set.names)}
    if any(f"{side}_wrist" not in row for side in SIDES):
        return found
    import cv2

    union = people.masks.any(0).astype(np.uint8)
    side_px = 2 * _GROWTH_PX + 1
    covered = cv2.dilate(union, np.ones((side_px, side_px), np.uint8)) > 0
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    for i, (points, confidence, box) in enumerate(
        zip(keypoints.points, keypoints.confidence, people.boxes, strict=True)
    ):
        size = float(max(box[2] - box[0], box[3] - box[1]))
        hands = [_hand(points, row, side) for side in SIDES]
        over = hands[1][1] - hands[0][1]  # of the left hand over the right one
        lower = np.array([over < _MAX_UNEVEN * size, over > -_MAX_UNEVEN * size])
        for k, side in enumerate(SIDES):
            sure = confidence[row[f"{side}_wrist"]] >= _MIN_CONFIDENCE
            found[i, k] = bool(sure and lower[k]) and is_at_edge(gray, covered, hands[k], size)
        found[i] = lower & found[i].any()
    return found


def is_at_edge(gray: NDArray[np.uint8], covered: BoolArray, hand: FloatArray, size: float) -> bool:
    """Return whether a straight edge outside of people leads to a hand.

    Args:
        gray: (H, W) uint8.
        covered: (H, W) bool, pixels of people.
        hand: (2,) px.
        size: of the person, px.
    """
    import cv2

    height, width = gray.shape
    if not np.isfinite(hand).all():
        return False
    x0, y0 = np.round(hand - _PATCH * size).astype(int)
    x1, y1 = np.round(hand + _PATCH * size).astype(int)
    x0 = max(0, x0)
    y0 = max(0, y0)
    x1 = min(width, x1)
    y1 = min(height, y1)
    if x1 - x0 < _MIN_PX or y1 - y0 < _MIN_PX:
        return False
    edges = cv2.Canny(gray[y0:y1, x0:x1], *_CANNY)
    edges[covered[y0:y1, x0:x1]] = 0
    length = max(_MIN_PX, _MIN_LENGTH * size)
    lines = cv2.HoughLinesP(
        edges,
        1,
        np.pi / 180,
        round(0.7 * length),
        minLineLength=length,
        maxLineGap=max(2.0, _MAX_GAP * size),
    )
    if lines is None:
        return False
    ends = lines.reshape(-1, 2, 2).astype(np.float64) + np.array([x0, y0])
    along = ends[:, 1] - ends[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    offset = hand - ends
    aside = np.abs(offset[:, 0, 0] * along[:, 1] - offset[:, 0, 1] * along[:, 0])
    beyond = np.maximum((-offset[:, 0] * along).sum(1), (offset[:, 1] * along).sum(1))
    return bool(((aside < _MAX_ASIDE * size) & (beyond < _MAX_AWAY * size)).any())


def _hand(points: FloatArray, row: dict[str, int], side: str) -> FloatArray:
    """Return the middle of a hand (2,) px: of the knuckles if the skeleton has them, else the
    wrist.
    """
    knuckles = [row[f"{side}_{name}"] for name in ("index1", "pinky1") if f"{side}_{name}" in row]
    return np.asarray(points[knuckles or [row[f"{side}_wrist"]]].mean(0), np.float64)
