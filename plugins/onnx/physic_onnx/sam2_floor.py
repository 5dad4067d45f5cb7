"""Segment the floor with SAM 2, prompted by points around people's feet.

A point beside a foot may lie on a rug, on the floor or on a sofa, and the network's three masks are
a part, an object and its surroundings. A mask must therefore pass a plausibility check. With a box
from the people's chests down, the mask of the floor is complete; without it, it is often in pieces.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_networks.pictures import resize_map

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, People

    from .sam2_networks import EncodedImage, Sam2Networks

GROUND_OFFSETS = np.array([[-1.0, 0.0], [1.0, 0.0], [-0.6, 0.4], [0.6, 0.4], [0.0, 0.5]])
"""Prompt points around a foot, in multiples of its reach."""

MOST_POINTS = 12


def floor_mask(networks: Sam2Networks, photo: EncodedImage, people: People) -> BoolArray | None:
    """Segment the floor (H, W); None if no feet are visible, or if no mask is plausible."""
    anybody: BoolArray = np.asarray(people.masks.any(axis=0))
    points = ground_points(people)
    if not len(points):
        return None
    points = points[np.linspace(0, len(points) - 1, min(len(points), MOST_POINTS)).astype(int)]
    logits, _ = networks.masks_from_points(
        photo, points, _person_centres(people), np.array([0, _chest_row(people), *photo.size[::-1]])
    )
    best = None
    best_score = 0.0
    for answer in logits:
        mask = np.asarray(resize_map(_connected_to_points(answer, photo, points), *photo.size) > 0)
        value = _ground_score(mask & ~anybody, mask, points, people)
        if value > best_score:
            best = mask & ~anybody
            best_score = value
    return best


def feet_positions(people: People) -> FloatArray:
    """Return (F, 3) px: column and row of each foot, and the radius of the ground area around the
    foot.

    A foot is the lower end of a mask with the aspect of a full person that does not touch the lower
    photo edge, if at least half of the people have one. The radius is a seventh of the person's
    height.
    """
    feet = []
    for mask, (x0, y0, x1, y1) in zip(people.masks, people.boxes, strict=True):
        height = y1 - y0
        if y1 < 0.985 * len(mask) and height > 1.6 * (x1 - x0):
            columns = np.nonzero(mask[int(y1 - max(1.0, 0.03 * height)) : int(y1)])[1]
            feet.append((float(np.median(columns)), y1 - 1, height / 7))
    return np.array(feet if 2 * len(feet) >= len(people) else [], float).reshape(-1, 3)


def ground_points(people: People) -> FloatArray:
    """Return prompt points (P, 2) px around the feet, outside all people and inside the photo."""
    anybody: BoolArray = np.asarray(people.masks.any(axis=0))
    height, width = anybody.shape
    feet = feet_positions(people)
    points = (feet[:, None, :2] + GROUND_OFFSETS * feet[:, None, 2:]).reshape(-1, 2)
    points = points[((points >= 1) & (points <= [width - 2, height - 2])).all(axis=1)]
    x, y = np.rint(points).astype(int).T
    return np.asarray(points[~anybody[y, x]])


def _connected_to_points(logits: FloatArray, photo: EncodedImage, points: FloatArray) -> FloatArray:
    """Return mask logits (h, w) of the components that contain a prompt point; -8 elsewhere.

    Large uniform areas are predicted as a grid of specks, which a blur of two cells joins.
    """
    import cv2

    smooth = cv2.GaussianBlur(np.clip(logits.astype(np.float32), -8, 8), (0, 0), 2.0)
    _, piece = cv2.connectedComponents((smooth > 0).astype(np.uint8), connectivity=4)
    height, width = photo.size
    column, row = ((points + 0.5) * np.array(logits.shape[::-1]) / [width, height]).astype(int).T
    pieces = np.unique(piece[row, column])
    lost = (smooth > 0) & ~np.isin(piece, pieces[pieces > 0])
    return np.where(lost, np.float32(-8), smooth)


def _person_centres(people: People) -> FloatArray:
    """Return a central mask pixel of each person, (Q, 2)."""
    middles = []
    for mask in people.masks[:6]:
        y, x = np.nonzero(mask)
        row = y[np.argsort(y)[len(y) // 2]]
        middles.append((float(np.median(x[y == row])), float(row)))
    return np.array(middles, float).reshape(-1, 2)


def _chest_row(people: People) -> float:
    """Return the median row of the chests, above which there is hardly any floor."""
    return float(np.median(people.boxes[:, 1] + 0.35 * (people.boxes[:, 3] - people.boxes[:, 1])))


def _ground_score(ground: BoolArray, mask: BoolArray, points: FloatArray, people: People) -> float:
    """Score how likely a mask is the floor; 0 if it cannot be.

    It holds the points beside the feet and hardly any of the people, hardly rises above their
    chests, and is large: a shoe's shadow is not floor.
    """
    x, y = np.rint(points).astype(int).T
    ground_share = float(ground[y, x].mean())
    area = int(ground.sum())
    anybody: BoolArray = np.asarray(people.masks.any(axis=0))
    on_people = float((mask & anybody).sum() / max(1, anybody.sum()))
    if ground_share < 0.6 or area < 0.01 * ground.size or on_people > 0.5:
        return 0.0
    high = float(ground[: max(0, int(_chest_row(people)))].sum() / area)
    # The ground that people stand on goes on towards the camera, or ends at something that stands
    # before it.
    wide = float(ground[int(points[:, 1].min()) :].any(axis=0).mean())
    if high > 0.35 or wide < 0.35:
        return 0.0
    return ground_share - on_people - high + 0.5 * area / ground.size
