"""Compute the inputs of the body fit for each person: viewing ray, size in px, keypoints and 3D
landmarks.

The landmarks are in the camera frame. A single-person pose network sees a crop and answers as if
its camera looked straight at the person; the photo's camera does not, so its landmarks belong to
the person's ray and not to the optical axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.types import SEEN_CONFIDENCE, Observations
from physic_embedded.body_fit.limb_keypoints import HIP_WEIGHT, sided_indices

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Intrinsics, Keypoints, People, Skeleton


SIZE_STATURE_M = 1.72
"""Height of the body that a size in px refers to; a unit, not a prior."""


_OUTSIDE = 0.05  # weight left to a keypoint outside the picture, which the network can only guess
_UNSEEN_WEIGHT = 0.1  # share of its 2D weight that a hidden keypoint keeps
LEAST_WORLD_WEIGHT = 0.15
"""Least weight of a 3D landmark."""


@dataclass(frozen=True)
class BodyObservations:
    """Keypoints, 3D landmarks, sizes and viewing directions of N people; J keypoints.

    Attributes:
        skeleton: joint set of the keypoints.
        intrinsics: of the photo.
        points: (N, J, 2) px.
        weight: (N, J) of the 2D points.
        confidence: (N, J), low outside the picture.
        size: (N,) px that a standing person of :data:`SIZE_STATURE_M` would span at this distance.
        turn: (N, 3, 3) rotation from the axes of a camera that looks straight at the person to this
            camera's.
        world: (N, J, 3) metres in the axes of that camera, the origin between the hips; None
            without 3D landmarks.
        world_weight: (N, J) of the 3D points.
        touch: (N, 2) probability that the left and the right foot touch something, by the picture.
        head: (N, 3) unit vectors in which the faces look, camera frame; NaN where unknown.
        head_sigma: (N,) radians, the same.
        sigma: (N, J) px of the 2D points, as the detector states it; None if it states none.
        depth_sigma: (N, J) metres of the depth of the 3D points, the same.
        spread: (N, J) metres by which the 3D points move between looks; None if the detector looks
            once.
    """

    skeleton: Skeleton
    intrinsics: Intrinsics
    points: FloatArray
    weight: FloatArray
    confidence: FloatArray
    size: FloatArray
    turn: FloatArray
    world: FloatArray | None
    world_weight: FloatArray
    touch: FloatArray
    head: FloatArray
    head_sigma: FloatArray
    sigma: FloatArray | None = None
    depth_sigma: FloatArray | None = None
    spread: FloatArray | None = None


def rotation_to_ray(ray: FloatArray) -> FloatArray:
    """Return the smallest rotation (3, 3) from the z axis to a ray (3,) that points forward."""

    z = ray / np.linalg.norm(ray)
    axis = np.cross([0.0, 0.0, 1.0], z)
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / (1 + z[2]))


def observe_people(
    keypoints: Keypoints, people: People, intrinsics: Intrinsics, person_observations: Observations
) -> BodyObservations:
    """Compute weights, sizes and viewing rays of all people.

    Args:
        keypoints: of a joint set with hips and shoulders; one row a person.
        people: their boxes give the size where there are no 3D landmarks.
        intrinsics: of the photo.
        person_observations: of the people, by the person observer.
    """
    from physic_core.engine.ground.stance import Stance

    skeleton = keypoints.joint_set
    hips = sided_indices(skeleton, "hip")
    points = np.asarray(keypoints.points, np.float64)
    confidence = _confidence_inside(keypoints, intrinsics)
    weight = np.where(confidence < SEEN_CONFIDENCE, _UNSEEN_WEIGHT, 1) * confidence
    weight[:, hips] *= HIP_WEIGHT
    world: FloatArray | None = (
        None if keypoints.world is None else np.asarray(keypoints.world, np.float64)
    )
    hips_center = points[:, hips].mean(1)
    if world is None:
        size = _size_without_landmarks(points, skeleton, people)
    else:
        is_missing = np.asarray(~np.isfinite(world).all(-1))
        if is_missing.any():
            world = _fill_lost_landmarks(world, is_missing, points, hips_center, confidence)
        world = world - world[:, hips].mean(1, keepdims=True)
        size = SIZE_STATURE_M * _pixels_per_metre(points, world, confidence)
    world_weight = np.maximum(confidence, LEAST_WORLD_WEIGHT)
    if world is not None:
        world_weight[is_missing] = 0
    # A face tells how the head turns, and its points where it is: 3D landmarks, 4 to 8 cm off,
    # hardly turn a head. Of ears in the picture, networks invent what the head hides.
    ears = np.array([name.endswith("ear_surface") for name in skeleton.names])
    weight[np.isfinite(person_observations.head_sigma)[:, None] & ears] = 0
    return BodyObservations(
        skeleton,
        intrinsics,
        points,
        weight,
        confidence,
        size,
        _rotations_to(hips_center, intrinsics),
        world,
        world_weight,
        Stance.in_picture(person_observations).limb_touch_probability[:, :2],
        np.asarray(person_observations.head, np.float64),
        np.radians(np.asarray(person_observations.head_sigma, np.float64)),
        keypoints.sigma,
        keypoints.depth_sigma,
        keypoints.world_spread,
    )


def _confidence_inside(keypoints: Keypoints, intrinsics: Intrinsics) -> FloatArray:
    """Return the confidence (N, J) of keypoints, above 0, and low outside of the photo."""
    limits = np.array([intrinsics.width, intrinsics.height]) - 0.5
    inside = ((keypoints.points > -0.5) & (keypoints.points < limits)).all(-1)
    stated = np.clip(np.asarray(keypoints.confidence, np.float64), 0.02, 1)
    return stated * np.where(inside, 1, _OUTSIDE)


def _rotations_to(pixels: FloatArray, intrinsics: Intrinsics) -> FloatArray:
    """Return the smallest rotations (N, 3, 3) from the z axis to the rays of pixels (N, 2)."""
    rays = np.stack(
        [
            (pixels[:, 0] - intrinsics.cx) / intrinsics.fx,
            (pixels[:, 1] - intrinsics.cy) / intrinsics.fy,
            np.ones(len(pixels)),
        ],
        -1,
    )
    return np.stack([rotation_to_ray(ray) for ray in rays])


def _fill_lost_landmarks(
    world: FloatArray,
    lost: BoolArray,
    points: FloatArray,
    middle: FloatArray,
    confidence: FloatArray,
) -> FloatArray:
    """Fill the 3D landmarks (N, J, 3) that are lost (N, J) by the picture, at the depth of the
    nearest known one.

    They only start the fit.
    """
    world = np.where(lost[..., None], 0.0, world)
    scale = _pixels_per_metre(points, world, confidence * ~lost)
    for i, j in np.argwhere(lost):
        gaps = np.linalg.norm(points[i] - points[i, j], axis=-1)
        depth = world[i, np.where(lost[i], np.inf, gaps).argmin(), 2]
        world[i, j] = [*((points[i, j] - middle[i]) / scale[i]), depth]
    return world


def _pixels_per_metre(points: FloatArray, world: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the scale (N,) of the weak perspective that maps the 3D landmarks to the keypoints."""

    total = weight.sum(1)[:, None, None]
    flat = world[..., :2]
    seen = points - (weight[..., None] * points).sum(1, keepdims=True) / total
    known = flat - (weight[..., None] * flat).sum(1, keepdims=True) / total
    scale = (weight * (seen * known).sum(-1)).sum(1) / ((weight * (known**2).sum(-1)).sum(1) + 1e-9)
    extent = np.ptp(points, axis=1).max(-1)
    # The lower bound is for landmarks that disagree completely with the picture.
    return np.asarray(np.maximum(scale, 0.1 * extent / SIZE_STATURE_M))


def _size_without_landmarks(points: FloatArray, skeleton: Skeleton, people: People) -> FloatArray:
    """Estimate the size in pixels from box, trunk and shoulders.

    The largest is taken, because each can only look too short.
    """
    shoulders, hips = (points[:, sided_indices(skeleton, name)] for name in ("shoulder", "hip"))
    trunk = np.linalg.norm(shoulders.mean(1) - hips.mean(1), axis=-1)
    wide = np.linalg.norm(shoulders[:, 0] - shoulders[:, 1], axis=-1)
    boxes = np.asarray(people.boxes, np.float64)
    tallest = boxes[:, 3] - boxes[:, 1]
    return np.asarray(np.maximum.reduce([3.3 * trunk, 4.4 * wide, tallest, np.ones(len(points))]))
