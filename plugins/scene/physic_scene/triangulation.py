"""Sizes of people by known cameras: keypoints triangulated from two photos or more, against single
photos' bodies.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError

if TYPE_CHECKING:
    from physic_core.types import FloatArray
    from physic_scene.bundle import MomentObservations
    from physic_scene.rigid import CameraPose

_SEEN = 0.3  # confidence of a keypoint
_FEWEST = 4  # triangulated keypoints, or bones, that give a size
_OTHER_UNIT = 1.5  # larger factors are no error of people's sizes
_LEAST_ANGLE = 1e-3  # smallest eigenvalue of the normal matrix of two rays: an angle of 2.6 degrees


def triangulate(
    points: FloatArray, weight: FloatArray, K: FloatArray, poses: Sequence[CameraPose]
) -> FloatArray:
    """Return the points (J, 3) with the least squares of distances from the rays of V photos, NaN
    where undetermined.

    Args:
        points: (V, J, 2) px.
        weight: (V, J), 0 where not seen.
        K: (V, 3, 3) px.
        poses: of the cameras.
    """
    rays = np.einsum(
        "vjx,vyx->vjy",
        np.concatenate([points, np.ones_like(points[..., :1])], -1),
        np.linalg.inv(K),
    )
    rays = np.stack([own @ pose.rotation for own, pose in zip(rays, poses, strict=True)])
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    across = weight[..., None, None] * (np.eye(3) - rays[..., :, None] * rays[..., None, :])
    normal = across.sum(0)
    centres = np.stack([pose.centre for pose in poses])
    least = np.linalg.eigvalsh(normal)[:, 0] / np.maximum(weight.max(0), 1e-9)
    known = ((weight > 0).sum(0) > 1) & (least > _LEAST_ANGLE)
    right = np.einsum("vjxy,vy->jx", across, centres)
    points_3d = np.full((points.shape[1], 3), np.nan)
    points_3d[known] = np.linalg.solve(normal[known], right[known][..., None])[..., 0]
    return points_3d


def sizes_by_cameras(observations: MomentObservations, poses: Sequence[CameraPose]) -> FloatArray:
    """Return the factor (P,) on the bones of each person that known cameras give; the median where
    they do not.

    Args:
        observations: of all photos.
        poses: of all cameras; those of known ones are used.

    Raises:
        InputError: the poses are not in metres, by the sizes of the people.
    """
    known_cameras = np.flatnonzero(observations.camera_is_known)
    factor = np.full(observations.is_visible.shape[1], np.nan)
    for p in range(len(factor)):
        confidence = observations.confidence[known_cameras, p]
        weight = np.where(
            confidence > _SEEN,
            (confidence / observations.size_px[known_cameras, p][:, None]) ** 2,
            0,
        )
        triangulated = triangulate(
            observations.points[known_cameras, p],
            weight,
            observations.K[known_cameras],
            [poses[v] for v in known_cameras.tolist()],
        )
        a, b = observations.bones.T
        ratio = np.linalg.norm(triangulated[a] - triangulated[b], axis=1) / observations.bone_m[p]
        if np.isfinite(ratio).sum() >= _FEWEST:
            factor[p] = np.exp(np.nanmedian(np.log(ratio)))
    every = float(np.nanmedian(factor)) if np.isfinite(factor).any() else 1.0
    if not 1 / _OTHER_UNIT < every < _OTHER_UNIT:
        raise InputError(
            "the known cameras are not in meters: by the sizes of the people, their unit is "
            f"{1 / every:.2g} m; give the true one with --camera-unit (unit_m of read_calibration "
            "in Python)"
        )
    factor[np.isnan(factor)] = every
    return factor
