"""The ground that people stand on: what MobileSAM takes for one thing around their feet."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from physic_embedded.networks.mobile_sam import prompt

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray
    from onnxruntime import InferenceSession

    from physic_embedded.networks.mobile_sam import Embedding
    from physic_embedded.networks.pose import Pose

    Bool = NDArray[np.bool_]
    Float = NDArray[np.floating[Any]]

__all__ = ["floor_mask", "ground_points", "seen_feet"]

FEET = ((27, 29, 31), (28, 30, 32))
"""Ankle, heel and toe of the left and of the right foot."""


def seen_feet(pose: Pose, width: int, height: int, clear: float = 0.5) -> list[Float]:
    """(2,) px, the point between heel and toe, of each foot whose ankle, heel and toe the photo shows."""
    confidence = pose.confidence(width, height)
    return [pose.points[list(f[1:])].mean(axis=0) for f in FEET if confidence[list(f)].min() > clear]


def ground_points(poses: Sequence[Pose], people: Bool, reach: float = 0.45) -> Float:
    """(P, 2) photo px beside and below the feet, on nobody and on the photo.

    Args:
        poses: of the people.
        people: (H, W), pixels of anybody.
        reach: how far from the middle of the foot, in lengths of the person's trunk.
    """
    height, width = people.shape
    ways = np.array([[-1.0, 0.0], [1.0, 0.0], [-0.6, 0.35], [0.6, 0.35], [0.0, 0.45]])
    points = [foot + ways * reach * pose.torso_length for pose in poses for foot in seen_feet(pose, width, height)]
    if not points:
        return np.zeros((0, 2))
    at = np.concatenate(points)
    margin = max(1.0, 0.004 * max(width, height))
    low, high = margin, np.array([width, height]) - 1 - margin
    at = at[((at >= low) & (at <= high)).all(axis=1)]
    x, y = np.rint(at).astype(int).T
    return np.asarray(at[~_grown(people, int(margin))[y, x]])


def floor_mask(
    decoder: InferenceSession, embedding: Embedding, poses: Sequence[Pose], people: Bool, most_points: int = 16
) -> Bool:
    """(H, W) pixels of the ground beside people's feet; all False where no foot is seen.

    Several answers are possible: a tile, the pavement, all that is not sky. Wanted is the largest that holds the points
    beside the feet, holds nobody, and hardly rises above the shoulders of those who stand.

    Args:
        decoder: session of ``mobilesam_decoder``.
        embedding: of the photo.
        poses: of the people.
        people: (H, W), pixels of anybody.
        most_points: no more points than this are shown to the network.
    """
    none = np.zeros_like(people)
    points = ground_points(poses, people)
    if not len(points):
        return none
    points = points[np.linspace(0, len(points) - 1, min(len(points), most_points)).astype(int)]
    nobody = _on_people(poses, people)
    answer = prompt(decoder, embedding, points, nobody)
    best, most = none, 0.0
    for logits in answer.logits:
        mask = embedding.to_photo(logits) > 0
        value = _plausibility(mask, points, people, poses)
        if value > most:
            best, most = mask, value
    return best & ~people


def _on_people(poses: Sequence[Pose], people: Bool) -> Float:
    """(Q, 2) photo px on the people: knees, hips and trunks, where a mask has them."""
    height, width = people.shape
    points = np.concatenate([[*p.points[[25, 26]], p.points[[11, 12, 23, 24]].mean(axis=0)] for p in poses])
    points = points[((points >= 0) & (points <= [width - 1, height - 1])).all(axis=1)]
    x, y = np.rint(points).astype(int).T
    return np.asarray(points[people[y, x]])


def _plausibility(mask: Bool, points: Float, people: Bool, poses: Sequence[Pose]) -> float:
    """How much a mask looks like the ground, 0 for one that cannot be it."""
    x, y = np.rint(points).astype(int).T
    held = mask[y, x].mean()
    area = mask.sum()
    if held < 0.5 or area == 0:
        return 0.0
    on_people = (mask & people).sum() / people.sum()
    height, width = people.shape
    shoulders = [p.points[[11, 12], 1].mean() for p in poses if seen_feet(p, width, height)]
    high = mask[: max(0, int(np.median(shoulders)))].sum() / area
    return float(held - on_people - high + 0.3 * area / mask.size)


def _grown(mask: Bool, radius: int) -> Bool:
    """A mask dilated by a disc."""
    import cv2

    side = 2 * radius + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), disc) > 0)
