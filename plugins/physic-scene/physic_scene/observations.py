"""What one photo shows of its people, as matching and camera solution use it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
import torch

from physic_core.body.convert.bodies import convert_bodies
from physic_core.body.landmarks import keypoints_on_body
from physic_core.body.parameters import rotations_from_parameters
from physic_core.types import CameraTrust
from physic_scene.measured import measured_errors
from physic_scene.rigid import CameraPose

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import BoolArray, FloatArray, Intrinsics, MomentView, Skeleton

COLOUR_GROUPS = (
    ("torso",),
    ("head",),
    ("left_upper_arm", "right_upper_arm"),
    ("left_upper_leg", "right_upper_leg"),
    ("left_lower_leg", "right_lower_leg"),
    ("left_foot", "right_foot"),
)
"""Body parts whose mean colours are compared."""

_KNOWN_FOCAL, _GUESSED_FOCAL = 0.003, 0.25  # standard deviations of log(focal length)

_FEWEST_PIXELS = 12  # of a body part, for its colour


@dataclass(frozen=True)
class PhotoPeople:
    """The N people of one photo who have a body, with J keypoints, in the frame of its camera, metres.

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


def observe(view: MomentView, model: BodyModel) -> PhotoPeople:
    """Return what one photo says about its people.

    Args:
        view: the photo; bodies of another body model are converted.
        model: body model, float64.
    """
    found = keypoints_on_body(view.keypoints)
    parameters = convert_bodies(view.bodies, model).parameters
    with torch.inference_mode():
        rotations = rotations_from_parameters(parameters, dtype=torch.float64)
        betas, transl = (torch.from_numpy(np.asarray(x, np.float64)) for x in (parameters.betas, parameters.transl))
        body = model(rotations, betas, transl)
        landmarks = model.landmarks(body, found.joint_set).numpy()
        stature = model.stature(betas).numpy()
    size = np.array([view.intrinsics.width, view.intrinsics.height])
    inside = ((found.points > -0.5) & (found.points < size - 0.5)).all(-1)
    finite = np.isfinite(found.points).all(-1) & np.isfinite(found.confidence)
    joints, vertices = body.joints.numpy(), body.vertices.numpy()
    colours = [_colours(view, vertices[i], view.people.masks[i], model) for i in range(len(vertices))]
    return PhotoPeople(
        K=view.intrinsics.matrix,
        focal_sigma=_focal_sigma(view.intrinsics),
        skeleton=found.joint_set,
        points=np.nan_to_num(np.asarray(found.points, np.float64)),
        confidence=np.where(inside & finite, found.confidence, 0.0),
        landmarks=landmarks,
        joints=joints,
        rotations=rotations.numpy(),
        betas=betas.numpy(),
        stature=stature,
        colours=np.array(colours).reshape(-1, len(COLOUR_GROUPS), 3),
        size_px=view.intrinsics.fy * stature / np.maximum(joints[:, 0, 2], 0.1),
        up=np.full(3, np.nan) if view.floor is None else np.asarray(view.floor.normal, np.float64),
        known_stature=np.asarray(view.statures, np.float64),
        pose=None if view.pose is None else CameraPose(view.pose[:3, :3], view.pose[:3, 3]).inverse(),
    )


def _focal_sigma(camera: Intrinsics) -> float:
    """Return the standard deviation of log(focal length); the measured one where an estimator states none."""
    if camera.focal_sigma:
        return camera.focal_sigma
    if camera.known:
        return _KNOWN_FOCAL
    estimated = float(np.hypot(*measured_errors().focal))
    return _GUESSED_FOCAL if camera.trust is CameraTrust.GUESSED else estimated


def _colours(view: MomentView, vertices: FloatArray, mask: BoolArray, model: BodyModel) -> FloatArray:
    """Return the mean CIELAB (G, 3) of a person's body parts: of the pixels of the mask (H, W) under each part."""
    K = view.intrinsics.matrix
    uv = np.round((vertices @ K.T)[:, :2] / np.maximum(vertices[:, 2:], 1e-3)).astype(int)
    height, width = mask.shape
    inside: BoolArray = ((uv >= 0) & (uv < [width, height])).all(1) & (vertices[:, 2] > 0.1)
    own = np.zeros(len(uv), bool)
    own[inside] = mask[uv[inside, 1], uv[inside, 0]]
    # Of several vertices at a pixel, the nearest is the one that the photo shows.
    nearest = np.full((height, width), np.inf)
    np.minimum.at(nearest, (uv[own, 1], uv[own, 0]), vertices[own, 2])
    own[own] = vertices[own, 2] < nearest[uv[own, 1], uv[own, 0]] + 0.05
    means = np.full((len(COLOUR_GROUPS), 3), np.nan)
    if not own.any():
        return means
    seen = np.asarray(view.image)[None, uv[own, 1], uv[own, 0]]
    lab = cv2.cvtColor(seen.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    part = model.part_of_vertex.numpy()[own]
    for row, names in enumerate(COLOUR_GROUPS):
        here = np.isin(part, [model.part_names.index(name) for name in names])
        if here.sum() >= _FEWEST_PIXELS:
            means[row] = np.median(lab[0, here], axis=0)
    return means
