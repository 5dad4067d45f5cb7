"""Fit bodies to 2D keypoints alone from several initial poses."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from physic_core.body import joint_pair
from physic_embedded.body_fit.fit import fit_bodies
from physic_embedded.body_fit.fit_problem import InitialPose
from physic_embedded.body_fit.initial_pose import initial_translation
from physic_embedded.body_fit.pose_prior import pose_prior

if TYPE_CHECKING:
    from physic_core.body import BodyModel
    from physic_embedded.body_fit.fit import FittedBodies
    from physic_embedded.body_fit.observations import BodyObservations

_YAWS = (0.0, 1.57, 3.14, -1.57)  # radians from facing the camera, of starts without landmarks
_SIT = {"hip": -1.4, "knee": 1.4}


def fit_without_world_landmarks(model: BodyModel, observations: BodyObservations) -> FittedBodies:
    """Fit each person from eight initial poses in one optimisation, and return each person's best
    fit.
    """
    mean, _ = pose_prior()
    sitting = mean.copy()
    for joint, angle in _SIT.items():
        sitting[np.subtract(joint_pair(joint), 1), 0] = angle
    starts = [(yaw, pose) for pose in (mean, sitting) for yaw in _YAWS]
    count = len(observations.points)
    skeleton = observations.skeleton
    facing = np.diag([1.0, -1.0, -1.0])  # y up and facing +z, seen by a camera whose y points down
    roots = []
    poses = []
    translations = []
    with torch.no_grad():
        for yaw, pose in starts:
            root = observations.turn @ facing @ Rotation.from_euler("y", yaw).as_matrix()
            rotations, betas, transl = model.zero_pose(count)
            rotvecs = np.concatenate([np.zeros((1, 3)), pose])
            rotations[:, :22] = torch.from_numpy(Rotation.from_rotvec(rotvecs).as_matrix())
            rotations[:, 0] = torch.from_numpy(root)
            posed = model.landmarks_only([skeleton])(rotations, betas, transl)[skeleton].numpy()
            roots.append(root)
            poses.append(np.broadcast_to(pose, (count, 21, 3)))
            translations.append(
                [initial_translation(p, observations, i) for i, p in enumerate(posed)]
            )
    tiled = _repeat_observations(observations, len(starts))
    start = InitialPose(np.concatenate(roots), np.concatenate(poses), np.concatenate(translations))
    return fit_bodies(model, tiled, start, starts=len(starts))


def _repeat_observations(observations: BodyObservations, times: int) -> BodyObservations:
    """Repeat the observations of all people a number of times."""
    arrays: dict[str, Any] = {
        field.name: np.concatenate([getattr(observations, field.name)] * times)
        for field in fields(observations)
        if isinstance(getattr(observations, field.name), np.ndarray)
    }
    return replace(observations, **arrays)
