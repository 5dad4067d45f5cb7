"""Segment the floor with MobileSAM, prompted by points around people's feet."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from physic_core.backends.masks import dilate
from physic_core.types import SURE_CONFIDENCE
from physic_embedded.networks.mobile_sam import predict_masks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types import BoolArray, FloatArray, SurfaceLabels
    from physic_embedded.networks.mobile_sam import ImageEmbedding
    from physic_embedded.networks.pose import Pose
    from physic_networks.onnx_sessions import OnnxSession


FEET = ((27, 29, 31), (28, 30, 32))
"""Landmark indices of ankle, heel and toe of the left and the right foot."""

_REACH = 0.45  # from the middle of the foot, in lengths of the person's trunk
_MOST_POINTS = 16  # that the network gets
LEAST_LABELLED = 0.02
"""Share of the picture. A smaller floor among the labels is ignored."""


def visible_feet(pose: Pose, width: int, height: int) -> list[FloatArray]:
    """Return the midpoint (2,) px of heel and toe of each foot whose ankle, heel and toe are
    visible.
    """
    confidence = pose.confidence(width, height)
    return [
        pose.points[list(f[1:])].mean(axis=0)
        for f in FEET
        if confidence[list(f)].min() > SURE_CONFIDENCE
    ]


def ground_points(poses: Sequence[Pose], people: BoolArray) -> FloatArray:
    """Return prompt points (P, 2) px beside and below the feet, outside all people and inside the
    photo.

    Args:
        poses: of the people.
        people: (H, W), pixels of people.
    """
    height, width = people.shape
    ways = np.array([[-1.0, 0.0], [1.0, 0.0], [-0.6, 0.35], [0.6, 0.35], [0.0, 0.45]])
    points = [
        foot + ways * _REACH * pose.torso_length
        for pose in poses
        for foot in visible_feet(pose, width, height)
    ]
    if not points:
        return np.zeros((0, 2))
    ground_px = np.concatenate(points)
    margin = max(1.0, 0.004 * max(width, height))
    low = margin
    high = np.array([width, height]) - 1 - margin
    ground_px = ground_px[((ground_px >= low) & (ground_px <= high)).all(axis=1)]
    x, y = np.rint(ground_px).astype(int).T
    return np.asarray(ground_px[~dilate(people, int(margin))[y, x]])


def floor_mask(
    decoder: OnnxSession,
    embedding: ImageEmbedding,
    poses: Sequence[Pose],
    people: BoolArray,
) -> BoolArray:
    """Segment the floor (H, W) beside people's feet; all False if no foot is visible.

    Several masks are possible: a tile, the pavement, everything but the sky. The largest one is
    chosen that holds the points beside the feet and no people, and hardly rises above the shoulders
    of standing people.

    Args:
        decoder: session of ``mobilesam_decoder``.
        embedding: of the photo.
        poses: of the people.
        people: (H, W), pixels of people.
    """
    best = np.zeros_like(people)
    points = ground_points(poses, people)
    if not len(points):
        return best
    points = points[np.linspace(0, len(points) - 1, min(len(points), _MOST_POINTS)).astype(int)]
    on_people = _person_points(poses, people)
    answer = predict_masks(decoder, embedding, points, on_people)
    best_plausibility = 0.0
    for logits in answer.logits:
        mask = embedding.to_photo(logits) > 0
        value = _plausibility(mask, points, people, poses)
        if value > best_plausibility:
            best = mask
            best_plausibility = value
    return best & ~people


def add_labelled_floor(
    beside_feet: BoolArray, surfaces: SurfaceLabels | None, people: BoolArray
) -> BoolArray:
    """Return the floor (H, W) by two opinions: the mask beside people's feet, and the labels of
    surfaces.

    Without people, the labels are the floor. Otherwise they extend the mask where they are
    connected with it. Where people have no visible feet, the labels are not used, since they may
    show a bench that people sit on.

    Args:
        beside_feet: (H, W) of :func:`floor_mask`.
        surfaces: of the same photo; without them, the floor is ``beside_feet``.
        people: (H, W), pixels of people.
    """
    if surfaces is None:
        return beside_feet
    labelled = surfaces.ground & ~people
    if labelled.mean() < LEAST_LABELLED:
        return beside_feet
    if not people.any():
        return np.asarray(labelled)
    either = beside_feet | labelled
    _, parts = cv2.connectedComponents(either.astype(np.uint8))
    return either & np.isin(parts, np.unique(parts[beside_feet]))


def _person_points(poses: Sequence[Pose], people: BoolArray) -> FloatArray:
    """(Q, 2) photo px on the people: knees, hips and trunks, where a mask has them."""
    height, width = people.shape
    points = np.concatenate(
        [[*p.points[[25, 26]], p.points[[11, 12, 23, 24]].mean(axis=0)] for p in poses]
    )
    points = points[((points >= 0) & (points <= [width - 1, height - 1])).all(axis=1)]
    x, y = np.rint(points).astype(int).T
    return np.asarray(points[people[y, x]])


def _plausibility(
    mask: BoolArray, points: FloatArray, people: BoolArray, poses: Sequence[Pose]
) -> float:
    """Score how likely a mask is the floor; 0 if it cannot be."""
    x, y = np.rint(points).astype(int).T
    held = mask[y, x].mean()
    area = mask.sum()
    if held < 0.5 or area == 0:
        return 0.0
    on_people = (mask & people).sum() / people.sum()
    height, width = people.shape
    shoulders = [p.points[[11, 12], 1].mean() for p in poses if visible_feet(p, width, height)]
    high = mask[: max(0, int(np.median(shoulders)))].sum() / area
    return float(held - on_people - high + 0.3 * area / mask.size)
