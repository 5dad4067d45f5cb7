"""Measures of a reconstruction without ground truth: its agreement with the photo, and with itself.

Everything is in metres in the OpenCV camera frame (x right, y down, z forward), unless a name says px or deg.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body.posture import is_body_straight, lean_deg
from physic_core.types import Skeleton, skeleton_named

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import Person, Plane, Reconstruction

    Array = NDArray[np.floating[Any]]

__all__ = [
    "PersonConsistency",
    "Summary",
    "consistency",
    "contact_distance",
    "inside_share",
    "keypoint_error_px",
    "lowest_height",
    "summarise",
]

VISIBLE = 0.3
"""Confidence from which a keypoint counts as seen."""

DEEP = 0.03
"""Metres inside the scene from which a vertex counts as deep inside."""


@dataclass(frozen=True)
class PersonConsistency:
    """Numbers of one person; NaN where the photo or the scene leaves nothing to measure.

    Attributes:
        keypoint_error_px: mean distance of the projected landmarks from the keypoints that are seen.
        keypoint_error_share: the same over the height of the person's box.
        contact_distance: median distance of the contact vertices to scene or floor.
        inside_share: share of all vertices that lie more than 3 cm inside the scene or the floor.
        sole_height: of the lowest sole vertex over the floor; negative below it.
        lowest_height: of the lowest vertex over the floor.
        lean_deg: tilt of a standing person against the floor's normal.
        lean_to_camera_deg: the part of it towards the camera; negative away from it.
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
    """One photo's numbers: means over its people, but for the median distance, which is over all contact vertices.

    Attributes:
        people: how many.
        keypoint_error_px: mean.
        contact_distance: median over the contact vertices of all people.
        inside_share: over the vertices of all people.
    """

    people: int
    keypoint_error_px: float
    contact_distance: float
    inside_share: float


def consistency(reconstruction: Reconstruction, model: BodyModel) -> tuple[PersonConsistency, ...]:
    """Numbers of every person.

    Args:
        reconstruction: of one photo.
        model: the body that its parameters are for.

    Raises:
        BodyModelError: the parameters are for another model, or it lacks a point of the skeleton.
        ValueError: no standard skeleton has the result's name.
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
            lean_deg(person.joints, floor) if floor and is_body_straight(person.joints) else (math.nan, math.nan)
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
    """The photo's row of a table."""
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
    """Mean distance in px over the keypoints that are seen; NaN where none is.

    Args:
        projected: (J, 2) px, landmarks of the body.
        keypoints: (J, 2) px, of the photo.
        confidence: (J,) in [0, 1].
        size: width and height of the photo, px; keypoints outside do not count.
        visible: least confidence of a keypoint that counts.
    """
    with np.errstate(invalid="ignore"):
        inside = ((keypoints > -0.5) & (keypoints < np.array(size) - 0.5)).all(-1)
    counted = inside & (confidence >= visible)
    return float(np.linalg.norm(projected[counted] - keypoints[counted], axis=-1).mean()) if counted.any() else math.nan


def contact_distance(distance: Array, contact: NDArray[np.bool_]) -> float:
    """Median |distance| in metres over contact vertices with a known distance; NaN where there is none."""
    known = contact & np.isfinite(distance)
    return float(np.median(np.abs(distance[known]))) if known.any() else math.nan


def inside_share(distance: Array, depth: float = DEEP) -> float:
    """Share of vertices whose signed distance (V,) is below ``-depth`` metres; unknown ones are outside."""
    return float(np.mean(distance < -depth)) if len(distance) else math.nan


def lowest_height(vertices: Array, floor: Plane | None) -> float:
    """Height in metres of the lowest of (M, 3) points over the floor; NaN without a floor or points."""
    if floor is None or not len(vertices):
        return math.nan
    return float((vertices @ np.asarray(floor.normal) + floor.offset).min())


def _landmarks_px(person: Person, reconstruction: Reconstruction, model: BodyModel, skeleton: Skeleton) -> Array:
    """(J, 2) px: where the body of the parameters has the points of a joint set."""
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
