"""Observations of one photo and its people, for matching and for the camera solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
import torch

from physic_core.body import keypoints_on_body, rotations_from_parameters
from physic_core.types import CameraTrust, Keypoints
from physic_scene.measured_errors import measured_errors
from physic_scene.rigid import CameraPose

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body import BodyModel
    from physic_core.types import (
        BoolArray,
        FloatArray,
        Intrinsics,
        Person,
        Reconstruction,
        Skeleton,
    )

COLOUR_GROUPS = (
    ("torso",),
    ("left_upper_arm", "right_upper_arm"),
    ("left_upper_leg", "right_upper_leg"),
    ("left_lower_leg", "right_lower_leg"),
)
"""Body parts with clothes, whose mean colours are compared."""

_KNOWN_FOCAL = 0.003  # sigma of log(focal length)
_GUESSED_FOCAL = 0.25  # sigma of log(focal length)

_FEWEST_PIXELS = 12  # of a body part, for its colour


@dataclass(frozen=True)
class PhotoPeople:
    """The N people of one photo who have a body, with J keypoints, in the frame of its camera,
    metres.

    Attributes:
        K: (3, 3) px.
        focal_sigma: standard deviation of log(focal length).
        skeleton: of the keypoints.
        points: (N, J, 2) px.
        confidence: (N, J) in [0, 1]; 0 for keypoints that are not seen.
        landmarks: (N, J, 3) the keypoints on the bodies.
        joints: (N, 55, 3).
        rotations: (N, 55, 3, 3) of each joint relative to its parent.
        betas: (N, K) shape.
        stature: (N,) metres.
        colours: (N, G, 3) mean CIELAB of each of COLOUR_GROUPS, NaN where it is not seen.
        size_px: (N,) stature in px.
        up: (3,) normal of the floor, NaN without one.
        known_stature: (N,) metres, as the user states them, NaN where unknown.
        pose: of the camera in its calibrated rig, metres; None where unknown.
    """

    K: FloatArray
    focal_sigma: float
    skeleton: Skeleton
    points: FloatArray
    confidence: FloatArray
    landmarks: FloatArray
    joints: FloatArray
    rotations: FloatArray
    betas: FloatArray
    stature: FloatArray
    colours: FloatArray
    size_px: FloatArray
    up: FloatArray
    known_stature: FloatArray
    pose: CameraPose | None = None

    def __len__(self) -> int:
        return len(self.points)


def _keypoints_of(result: Reconstruction, people: Sequence[Person]) -> Keypoints:
    """Return the keypoints of people of a result."""
    if not people:
        return Keypoints(np.zeros((0, 17, 2)), np.zeros((0, 17)), "coco17")
    return Keypoints(
        np.stack([person.keypoints for person in people]),
        np.stack([person.keypoint_confidence for person in people]),
        result.skeleton,
    )


def _confidence_inside(keypoints: Keypoints, camera: Intrinsics) -> FloatArray:
    """Return the confidence (N, J), 0 outside the photo and where a number is not finite."""
    points = keypoints.points
    size = np.array([camera.width, camera.height])
    inside = ((points > -0.5) & (points < size - 0.5)).all(-1)
    finite = np.isfinite(points).all(-1) & np.isfinite(keypoints.confidence)
    return np.where(inside & finite, keypoints.confidence, 0.0)


def _parameters_of(people: Sequence[Person], model: BodyModel) -> tuple[Tensor, Tensor, Tensor]:
    """Return local rotations, betas and translations of people, float64."""
    if not people:
        return model.zero_pose(0)
    parameters = [person.parameters for person in people]
    rotations = [rotations_from_parameters(own, dtype=torch.float64) for own in parameters]
    betas, transl = (
        torch.from_numpy(
            np.concatenate([getattr(own, name) for own in parameters]).astype(np.float64)
        )
        for name in ("betas", "transl")
    )
    return torch.cat(rotations), betas, transl


def observe(
    result: Reconstruction,
    rows: Sequence[int],
    model: BodyModel,
    statures: FloatArray,
    pose: FloatArray | None = None,
) -> PhotoPeople:
    """Return the observations of one photo and its people.

    Args:
        result: of the photo alone.
        rows: (N,) index of each person who has a body.
        model: body model of the result, float64.
        statures: (N,) known heights, metres, NaN where unknown.
        pose: (4, 4) from the frame of its camera to that of a calibrated rig, metres; None where
            unknown.
    """
    people = [result.people[i] for i in rows]
    camera = result.intrinsics
    floor = result.scene.floor

    keypoints = keypoints_on_body(_keypoints_of(result, people))
    rotations, betas, transl = _parameters_of(people, model)
    with torch.inference_mode():
        body = model(rotations, betas, transl)
        landmarks = model.landmarks(body, keypoints.joint_set).numpy()
        stature = model.stature(betas).numpy()
    joints = body.joints.numpy()
    vertices = body.vertices.numpy()
    colours = [
        _clothing_colors(result, vertices[i], person.mask, model) for i, person in enumerate(people)
    ]
    return PhotoPeople(
        K=camera.matrix,
        focal_sigma=_focal_sigma(camera),
        skeleton=keypoints.joint_set,
        points=np.nan_to_num(np.asarray(keypoints.points, np.float64)),
        confidence=_confidence_inside(keypoints, camera),
        landmarks=landmarks,
        joints=joints,
        rotations=rotations.numpy(),
        betas=betas.numpy(),
        stature=stature,
        colours=np.array(colours).reshape(-1, len(COLOUR_GROUPS), 3),
        size_px=camera.fy * stature / np.maximum(joints[:, 0, 2], 0.1),
        up=np.full(3, np.nan) if floor is None else np.asarray(floor.normal, np.float64),
        known_stature=statures,
        pose=None if pose is None else CameraPose(pose[:3, :3], pose[:3, 3]).inverse(),
    )


def _focal_sigma(camera: Intrinsics) -> float:
    """Return the standard deviation of log(focal length); the measured one where an estimator
    states none.
    """
    if camera.focal_sigma:
        return camera.focal_sigma
    if camera.known:
        return _KNOWN_FOCAL
    estimated = float(np.linalg.norm(measured_errors().focal))
    return _GUESSED_FOCAL if camera.trust is CameraTrust.GUESSED else estimated


def _clothing_colors(
    result: Reconstruction, vertices: FloatArray, mask: BoolArray, model: BodyModel
) -> FloatArray:
    """Return the mean CIELAB (G, 3) of a person's body parts: of the pixels of the mask (H, W)
    under each part.
    """
    K = result.intrinsics.matrix
    uv = np.round((vertices @ K.T)[:, :2] / np.maximum(vertices[:, 2:], 1e-3)).astype(int)
    height, width = mask.shape
    inside: BoolArray = ((uv >= 0) & (uv < [width, height])).all(1) & (vertices[:, 2] > 0.1)
    is_on_mask = np.zeros(len(uv), bool)
    is_on_mask[inside] = mask[uv[inside, 1], uv[inside, 0]]
    # Of several vertices at a pixel, the nearest is the one that the photo shows.
    nearest = np.full((height, width), np.inf)
    np.minimum.at(nearest, (uv[is_on_mask, 1], uv[is_on_mask, 0]), vertices[is_on_mask, 2])
    is_on_mask[is_on_mask] = (
        vertices[is_on_mask, 2] < nearest[uv[is_on_mask, 1], uv[is_on_mask, 0]] + 0.05
    )
    means = np.full((len(COLOUR_GROUPS), 3), np.nan)
    if not is_on_mask.any():
        return means
    colors = np.asarray(result.image)[None, uv[is_on_mask, 1], uv[is_on_mask, 0]]
    lab = cv2.cvtColor(colors.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    part = model.part_of_vertex.numpy()[is_on_mask]
    for row, names in enumerate(COLOUR_GROUPS):
        is_on_part = np.isin(part, [model.part_names.index(name) for name in names])
        if is_on_part.sum() >= _FEWEST_PIXELS:
            means[row] = np.median(lab[0, is_on_part], axis=0)
    return means
