"""Which objects of a photo people hold in their hands or have on their laps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Keypoints, People

_SEEN = 0.3  # least confidence of a keypoint
_HAND_LENGTH = 0.4  # from the wrist to the middle of the fingers, as a share of the forearm in the photo
_REACH = 0.12  # of the longer side of a person's box: half the length of a hand and the errors of keypoints
_LAP = np.linspace(0.2, 1.0, 5)  # along the thigh


def select_held_objects(people: People, keypoints: Keypoints) -> BoolArray | None:
    """Return the objects (K, H, W) bool that lie near a visible hand or lap, without the pixels of people.

    Args:
        people: of the photo, with or without objects.
        keypoints: of the same people.

    Returns:
        None if the segmenter does not look for objects.
    """
    import cv2

    if people.objects is None:
        return None
    visible = people.objects & ~people.masks.any(axis=0)
    held = []
    for mask in visible:
        if not mask.any():
            continue
        away = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
        if any(_is_near(away, points, reach) for points, reach in _hands_and_laps(people, keypoints)):
            held.append(mask)
    return np.array(held, bool).reshape(-1, *visible.shape[1:])


def _hands_and_laps(people: People, keypoints: Keypoints) -> list[tuple[FloatArray, float]]:
    """Return for each person points (M, 2) px on visible hands and thighs, and the reach around them, px."""
    names = keypoints.joint_set.names
    found: list[tuple[FloatArray, float]] = []
    for i, box in enumerate(np.asarray(people.boxes, np.float64)):
        seen = {
            name: keypoints.points[i, j].astype(np.float64)
            for j, name in enumerate(names)
            if keypoints.confidence[i, j] > _SEEN
        }
        points = []
        for side in SIDES:
            wrist, elbow, hip, knee = (seen.get(f"{side}_{joint}") for joint in ("wrist", "elbow", "hip", "knee"))
            if wrist is not None:
                forearm = np.zeros(2) if elbow is None else wrist - elbow
                points += [wrist, wrist + _HAND_LENGTH * forearm]
            if hip is not None and knee is not None:
                points += list(hip + _LAP[:, None] * (knee - hip))
        reach = _REACH * float(max(box[2] - box[0], box[3] - box[1]))
        found.append((np.array(points, np.float64).reshape(-1, 2), reach))
    return found


def _is_near(away: FloatArray, points: FloatArray, reach: float) -> bool:
    """Return whether one of the points (M, 2) px is within ``reach`` of a mask at distance ``away`` (H, W) px."""
    height, width = away.shape
    pixel = np.rint(points).astype(np.int64)
    inside = ((pixel >= 0) & (pixel < (width, height))).all(axis=1)
    column, row = pixel[inside].T
    return bool((away[row, column] <= reach).any())
