"""Compute closed-form initial poses for the body fit from 3D landmarks, limb by limb.

Zero rotations are a T-pose, y up, facing +z, left on +x; every frame here has these axes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from physic_core.body import JOINT_INDEX
from physic_embedded.body_fit.limb_keypoints import keypoint_indices
from physic_embedded.body_fit.observations import SIZE_STATURE_M

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Skeleton
    from physic_embedded.body_fit.observations import BodyObservations


_STRAIGHT = 0.25  # sine of the bend under which a limb shows no hinge axis
_SPINE_LIMIT = 1.2  # radians between hips and shoulders


def pose_from_landmarks(landmarks: FloatArray, skeleton: Skeleton) -> tuple[FloatArray, FloatArray]:
    """Convert landmarks (J, 3) in camera axes to a root rotation (3, 3) and rotation vectors (21,
    3) of joints 1 to 21.

    Wrists, ankles, neck and collars stay at zero. A knee that would bend forward is a wrong depth:
    it keeps the side of the pelvis.
    """
    row = keypoint_indices(skeleton)

    def at(name: str) -> FloatArray:
        return np.asarray(landmarks[row[name]])

    hips = at("left_hip") - at("right_hip")
    shoulders = at("left_shoulder") - at("right_shoulder")
    up = (at("left_shoulder") + at("right_shoulder") - at("left_hip") - at("right_hip")) / 2
    pelvis = _frame_from_x(hips + 0.3 * shoulders, up)
    chest = _frame_from_y(up, shoulders)
    pose = np.zeros((21, 3))
    twist = _rotvec(pelvis.T @ chest)
    twist = twist * min(1.0, _SPINE_LIMIT / (float(np.linalg.norm(twist)) + 1e-9))
    for name in ("spine1", "spine2", "spine3"):
        pose[JOINT_INDEX[name] - 1] = twist / 3
    chest = pelvis @ Rotation.from_rotvec(twist).as_matrix()
    for side, sign in (("left", 1.0), ("right", -1.0)):
        thigh = _normalise(at(f"{side}_knee") - at(f"{side}_hip"))
        shank = _normalise(at(f"{side}_ankle") - at(f"{side}_knee"))
        pose[JOINT_INDEX[f"{side}_hip"] - 1], bend = bent_leg(thigh, shank, pelvis)
        pose[JOINT_INDEX[f"{side}_knee"] - 1, 0] = bend
        upper = _normalise(at(f"{side}_elbow") - at(f"{side}_shoulder"))
        fore = _normalise(at(f"{side}_wrist") - at(f"{side}_elbow"))
        pose[JOINT_INDEX[f"{side}_shoulder"] - 1], bend = _bent_arm(upper, fore, chest, sign)
        pose[JOINT_INDEX[f"{side}_elbow"] - 1, 1] = bend
    return pelvis, pose


def bent_leg(thigh: FloatArray, shank: FloatArray, pelvis: FloatArray) -> tuple[FloatArray, float]:
    """Return rotation vector (3,) of the hip and bend of the knee, radians, for unit directions
    (3,) and a pelvis (3, 3).
    """
    axis = np.cross(thigh, shank)
    if np.linalg.norm(axis) < _STRAIGHT or axis @ pelvis[:, 0] < -0.2 * np.linalg.norm(axis):
        axis = pelvis[:, 0]
    leg = _frame_from_y(-thigh, axis)
    local = leg.T @ shank
    return _rotvec(pelvis.T @ leg), float(np.clip(np.arctan2(-local[2], -local[1]), 0.0, 2.6))


def _bent_arm(
    upper: FloatArray, fore: FloatArray, chest: FloatArray, sign: float
) -> tuple[FloatArray, float]:
    """Return rotation vector (3,) of the shoulder and bend of the elbow, radians, for unit
    directions (3,), a chest (3, 3), and 1 for the left or -1 for the right arm.
    """
    axis = np.cross(upper, fore)
    arm: FloatArray
    if np.linalg.norm(axis) < _STRAIGHT:
        arm = chest @ _rotation_between(np.array([sign, 0.0, 0.0]), chest.T @ upper)
    else:
        arm = _frame_from_x(sign * upper, -sign * axis)
    bend = -sign * float(np.arctan2(np.linalg.norm(axis), upper @ fore))
    return _rotvec(chest.T @ arm), bend


def initial_translation(
    landmarks: FloatArray, observations: BodyObservations, i: int
) -> FloatArray:
    """Return the translation (3,) with which the landmarks (J, 3), metres in camera axes, of person
    ``i`` project onto this person's keypoints, by linear least squares; on the ray of the hips
    where that is not in front of the camera.
    """
    camera = observations.intrinsics.matrix
    points = observations.points[i]
    weight = observations.confidence[i]
    u = (points - camera[:2, 2]) / camera[[0, 1], [0, 1]]
    # (X + tx) = u (Z + tz) in both image directions
    design = np.zeros((2, len(points), 3))
    design[0, :, 0] = design[1, :, 1] = 1
    design[..., 2] = -u.T
    right = u.T * landmarks[:, 2] - landmarks[:, :2].T
    solution = np.linalg.lstsq(
        (design * weight[:, None]).reshape(-1, 3), (right * weight).reshape(-1), rcond=None
    )[0]
    if solution[2] > 0.2:
        return np.asarray(solution)
    ray = observations.turn[i][:, 2]
    return np.asarray(ray / ray[2] * camera[1, 1] * SIZE_STATURE_M / observations.size[i])


def _rotvec(matrix: FloatArray) -> FloatArray:
    """Convert a rotation (3, 3) to a rotation vector (3,)."""
    return np.asarray(Rotation.from_matrix(matrix).as_rotvec())


def _normalise(vector: FloatArray) -> FloatArray:
    """Scale a vector to unit length."""
    return vector / (np.linalg.norm(vector) + 1e-9)


def _frame_from_x(x: FloatArray, near_y: FloatArray) -> FloatArray:
    """Return the frame with this x axis and a y axis as close as possible to another direction;
    axes are columns.
    """

    x = _normalise(x)
    y = _normalise(near_y - near_y @ x * x)
    return np.stack([x, y, np.cross(x, y)], 1)


def _frame_from_y(y: FloatArray, near_x: FloatArray) -> FloatArray:
    """Return the frame with this y axis and an x axis as close as possible to another direction;
    axes are columns.
    """

    y = _normalise(y)
    x = _normalise(near_x - near_x @ y * y)
    return np.stack([x, y, np.cross(x, y)], 1)


def _rotation_between(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the smallest rotation (3, 3) from one unit vector to another."""
    axis = np.cross(start, end)
    angle = np.arctan2(np.linalg.norm(axis), start @ end)
    if np.linalg.norm(axis) < 1e-6:
        axis = np.array([0.0, 0.0, 1.0])  # opposite: any axis
    return np.asarray(Rotation.from_rotvec(angle * _normalise(axis)).as_matrix())
