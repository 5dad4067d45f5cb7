"""Sizes of people by known cameras: keypoints triangulated from two photos or more, against single photos' bodies."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import FloatArray
    from physic_scene.bundle import MomentObservations
    from physic_scene.observations import PhotoPeople
    from physic_scene.rigid import CameraPose

_SEEN = 0.3  # confidence of a keypoint
_FEWEST = 4  # triangulated keypoints, or bones, that give a size
_LEAST_ANGLE = 1e-3  # smallest eigenvalue of the normal matrix of two rays: an angle of 2.6 degrees


def triangulate(points: FloatArray, weight: FloatArray, K: FloatArray, poses: Sequence[CameraPose]) -> FloatArray:
    """Return the points (J, 3) with the least squares of distances from the rays of V photos, NaN where undetermined.

    Args:
        points: (V, J, 2) px.
        weight: (V, J), 0 where not seen.
        K: (V, 3, 3) px.
        poses: of the cameras.
    """
    rays = np.einsum("vjx,vyx->vjy", np.concatenate([points, np.ones_like(points[..., :1])], -1), np.linalg.inv(K))
    rays = np.stack([own @ pose.rotation for own, pose in zip(rays, poses, strict=True)])
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    across = weight[..., None, None] * (np.eye(3) - rays[..., :, None] * rays[..., None, :])
    normal = across.sum(0)
    centres = np.stack([pose.centre for pose in poses])
    least = np.linalg.eigvalsh(normal)[:, 0] / np.maximum(weight.max(0), 1e-9)
    known = ((weight > 0).sum(0) > 1) & (least > _LEAST_ANGLE)
    right = np.einsum("vjxy,vy->jx", across, centres)
    found = np.full((points.shape[1], 3), np.nan)
    found[known] = np.linalg.solve(normal[known], right[known][..., None])[..., 0]
    return found


def rig_unit(photos: Sequence[PhotoPeople], most_off: float) -> float | None:
    """Return the length of the unit of known poses, metres, by the depths of people in single photos.

    Every two people of two photos are triangulated; those whose keypoints agree are taken to be the same person.

    Args:
        photos: with their poses, in an unknown unit.
        most_off: largest median distance of keypoints that agree, as a share of the stature in px.

    Returns:
        The median over people, or None if no person is in two photos of known pose.
    """
    found = []
    for one, two in itertools.combinations([photo for photo in photos if photo.pose is not None], 2):
        for i, j in np.ndindex(len(one), len(two)):
            seen = np.stack([one.confidence[i], two.confidence[j]])
            both = (seen > _SEEN).all(0)
            points = np.stack([one.points[i], two.points[j]])
            poses = [photo.pose for photo in (one, two) if photo.pose is not None]
            at = triangulate(points, seen * both, np.stack([one.K, two.K]), poses)
            both &= np.isfinite(at).all(1)
            if both.sum() < _FEWEST:
                continue
            for photo, row, pose in ((one, i, poses[0]), (two, j, poses[1])):
                local = pose.to_camera(at[both])
                pixels = local @ photo.K.T
                off = np.linalg.norm(pixels[:, :2] / pixels[:, 2:] - photo.points[row, both], axis=1)
                if not (local[:, 2] > 0).all() or np.median(off) > most_off * photo.size_px[row]:
                    break
                found.append(float(np.median(photo.landmarks[row, both, 2] / local[:, 2])))
    return float(np.median(found)) if found else None


def sizes_by_cameras(observations: MomentObservations, poses: Sequence[CameraPose]) -> FloatArray:
    """Return the factor (P,) on the bones of each person that known cameras give; the median where they do not.

    Args:
        observations: of all photos.
        poses: of all cameras; those of known ones are used.
    """
    own = np.flatnonzero(observations.known)
    factor = np.full(observations.shown.shape[1], np.nan)
    for p in range(len(factor)):
        confidence = observations.confidence[own, p]
        weight = np.where(confidence > _SEEN, (confidence / observations.size_px[own, p][:, None]) ** 2, 0)
        at = triangulate(observations.points[own, p], weight, observations.K[own], [poses[v] for v in own.tolist()])
        a, b = observations.bones.T
        ratio = np.linalg.norm(at[a] - at[b], axis=1) / observations.bone_m[p]
        if np.isfinite(ratio).sum() >= _FEWEST:
            factor[p] = np.exp(np.nanmedian(np.log(ratio)))
    factor[np.isnan(factor)] = np.nanmedian(factor) if np.isfinite(factor).any() else 1.0
    return factor
