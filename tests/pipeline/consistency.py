"""Measures of a result without ground truth: agreement with the photo, depth in the scene and
posture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch

from physic_core.body.bones import rotations_from_parameters
from physic_core.body.posture import lean_deg, standing_legs
from physic_core.types import skeleton_named


@dataclass(frozen=True)
class PersonConsistency:
    """Measures of one person; NaN if unknown.

    Attributes:
        keypoint_error_share: mean distance of the landmarks from the visible keypoints, of the
            height of the box.
        inside_share: of the vertices, those more than 3 cm inside the scene or the floor.
        sole_height: m of the lowest sole vertex over the floor.
        lean_deg: of a standing person from the floor's normal.
    """

    keypoint_error_share: float
    inside_share: float
    sole_height: float
    lean_deg: float


def consistency(result, model):
    """Measure every person of a result."""
    soles = np.concatenate(
        [model.contact_sets[f"{side}_sole"].numpy() for side in ("left", "right")]
    )
    floor = result.scene.floor
    found = []
    for person in result.people:
        height = lean = math.nan
        if floor is not None:
            height = float((person.vertices[soles] @ np.asarray(floor.normal) + floor.offset).min())
            lean = (
                lean_deg(person.joints, floor)[0]
                if standing_legs(person.joints).all()
                else math.nan
            )
        share = keypoint_error_px(person, result, model) / float(person.box[3] - person.box[1])
        found.append(
            PersonConsistency(share, float(np.mean(person.distance < -0.03)), height, lean)
        )
    return found


def keypoint_error_px(person, result, model):
    """Mean distance of the projected landmarks from the keypoints of some confidence inside the
    photo.
    """
    skeleton = skeleton_named(result.skeleton)
    parameters = person.parameters
    columns = list(skeleton.fitted)
    betas, transl, expression = (
        torch.from_numpy(np.array(value, np.float32)).to(model.dtype)
        for value in (parameters.betas, parameters.transl, parameters.expression)
    )
    with torch.inference_mode():
        output = model(
            rotations_from_parameters(parameters, model.device, model.dtype),
            betas,
            transl,
            expression,
        )
        points = model.landmarks(output, skeleton.take(columns))[0].numpy().astype(np.float64)
    pixels = points @ result.intrinsics.matrix.T
    keypoints = person.keypoints[columns]
    size = np.array(result.image.shape[1::-1])
    counted = (keypoints > -0.5).all(-1) & (keypoints < size - 0.5).all(-1)
    counted &= person.keypoint_confidence[columns] >= 0.3
    return float(np.linalg.norm(pixels[:, :2] / pixels[:, 2:] - keypoints, axis=-1)[counted].mean())
