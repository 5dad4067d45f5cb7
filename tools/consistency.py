"""Measures of a reconstruction without ground truth: agreement with the photo, contact and posture.

Metres, OpenCV camera frame (x right, y down, z forward).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body.posture import lean_deg, standing_legs
from physic_core.types import Skeleton, skeleton_named

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import Person, Plane, Reconstruction

    Array = NDArray[np.floating[Any]]

VISIBLE = 0.3
"""Least confidence of a visible keypoint."""

DEEP = 0.03
"""Least depth, metres, of a vertex deep inside the scene."""


@dataclass(frozen=True)
class PersonConsistency:
    """Measures of one person; NaN if unknown.

    Attributes:
        keypoint_error_px: mean distance of the projected landmarks from the visible keypoints.
        keypoint_error_share: the same, relative to the height of the person's box.
        contact_distance: median distance of the contact vertices to scene or floor.
        inside_share: share of vertices more than 3 cm inside the scene or the floor.
        sole_height: of the lowest sole vertex over the floor.
        lowest_height: of the lowest vertex over the floor.
        lean_deg: tilt of a standing person from the floor's normal.
        lean_to_camera_deg: the part of the tilt towards the camera; negative away from it.
    """

    keypoint_error_px: float
    keypoint_error_share: float
    contact_distance: float
    inside_share: float
    sole_height: float
    lowest_height: float
    lean_deg: float
    lean_to_camera_deg: float


@dataclass(frozen=True)
class Summary:
    """Measures of one photo.

    Attributes:
        people: number of people.
        keypoint_error_px: mean over people.
        contact_distance: median over the contact vertices of all people.
        inside_share: over the vertices of all people.
    """

    people: int
    keypoint_error_px: float
    contact_distance: float
    inside_share: float


def consistency(reconstruction: Reconstruction, model: BodyModel) -> tuple[PersonConsistency, ...]:
    """Measure every person of a reconstruction.

    Args:
        reconstruction: of one photo.
        model: body model of its parameters.

    Raises:
        BodyModelError: the parameters are for another model, or it does not have a point of the skeleton.
        ValueError: the skeleton is unknown.
    """
    soles = np.concatenate([model.contact_sets[f"{side}_sole"].cpu().numpy() for side in ("left", "right")])
    floor = reconstruction.scene.floor
    answers = []
    skeleton = skeleton_named(reconstruction.skeleton)
    columns = list(skeleton.fitted)
    for person in reconstruction.people:
        height, width = reconstruction.image.shape[:2]
        error = keypoint_error_px(
            _landmarks_px(person, reconstruction, model, skeleton.take(columns)),
            person.keypoints[columns],
            person.keypoint_confidence[columns],
            size=(width, height),
        )
        lean, to_camera = (
            lean_deg(person.joints, floor) if floor and standing_legs(person.joints).all() else (math.nan, math.nan)
        )
        answers.append(
            PersonConsistency(
                keypoint_error_px=error,
                keypoint_error_share=error / max(float(person.box[3] - person.box[1]), 1.0),
                contact_distance=contact_distance(person.distance, person.contact),
                inside_share=inside_share(person.distance),
                sole_height=lowest_height(person.vertices[soles], floor),
                lowest_height=lowest_height(person.vertices, floor),
                lean_deg=lean,
                lean_to_camera_deg=to_camera,
            )
        )
    return tuple(answers)


def summarise(reconstruction: Reconstruction, people: tuple[PersonConsistency, ...]) -> Summary:
    """Combine the measures of all people of a photo."""
    distances = [person.distance for person in reconstruction.people]
    contacts = [person.contact for person in reconstruction.people]
    return Summary(
        people=len(people),
        keypoint_error_px=_mean([person.keypoint_error_px for person in people]),
        contact_distance=contact_distance(np.concatenate(distances), np.concatenate(contacts)) if people else math.nan,
        inside_share=inside_share(np.concatenate(distances)) if people else math.nan,
    )


def keypoint_error_px(
    projected: Array, keypoints: Array, confidence: Array, *, size: tuple[int, int], visible: float = VISIBLE
) -> float:
    """Return the mean reprojection error, px, of the visible keypoints; NaN if none is visible.

    Args:
        projected: (J, 2) px, landmarks of the body.
        keypoints: (J, 2) px, of the photo.
        confidence: (J,) in [0, 1].
        size: width and height of the photo, px; keypoints outside do not count.
        visible: least confidence of a visible keypoint.
    """
    with np.errstate(invalid="ignore"):
        inside = ((keypoints > -0.5) & (keypoints < np.array(size) - 0.5)).all(-1)
    counted = inside & (confidence >= visible)
    return float(np.linalg.norm(projected[counted] - keypoints[counted], axis=-1).mean()) if counted.any() else math.nan


def contact_distance(distance: Array, contact: NDArray[np.bool_]) -> float:
    """Return the median absolute distance, metres, of contact vertices with known distance; NaN if there are none."""
    known = contact & np.isfinite(distance)
    return float(np.median(np.abs(distance[known]))) if known.any() else math.nan


def inside_share(distance: Array, depth: float = DEEP) -> float:
    """Return the share of vertices with a signed distance (V,) below ``-depth`` metres."""
    return float(np.mean(distance < -depth)) if len(distance) else math.nan


def lowest_height(vertices: Array, floor: Plane | None) -> float:
    """Return the height of the lowest of points (M, 3) over the floor, metres; NaN without floor or points."""
    if floor is None or not len(vertices):
        return math.nan
    return float((vertices @ np.asarray(floor.normal) + floor.offset).min())


def _landmarks_px(person: Person, reconstruction: Reconstruction, model: BodyModel, skeleton: Skeleton) -> Array:
    """Project the landmarks of a person's body, (J, 2) px."""
    import torch

    from physic_core.body.parameters import rotations_from_parameters

    parameters = person.parameters
    betas, expression, transl = (
        torch.from_numpy(np.array(value, np.float32)).to(model.device, model.dtype)
        for value in (parameters.betas, parameters.expression, parameters.transl)
    )
    with torch.inference_mode():
        output = model(rotations_from_parameters(parameters, model.device, model.dtype), betas, transl, expression)
        points = model.landmarks(output, skeleton)[0].cpu().numpy().astype(np.float64)
    spots = points @ reconstruction.intrinsics.matrix.T
    return np.asarray(spots[:, :2] / spots[:, 2:])


def _mean(values: list[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return float(np.mean(known)) if known else math.nan
