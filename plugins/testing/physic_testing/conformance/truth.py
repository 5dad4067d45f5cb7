"""Conversion of ground truth and backend results to a common form for comparison."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import (
    JOINT_INDEX,
    head_direction,
    keypoints_on_body,
    load_body,
    pose_from_parameters,
    rotations_from_parameters,
    rotations_from_tpose,
)
from physic_core.conversion import can_convert, convert_bodies, convert_contact
from physic_core.engine.body_parts import OBSERVED, are_adjacent, contact_regions
from physic_core.geometry import rotmat_to_rotvec, rotvec_to_rotmat_numpy
from physic_core.types import POSTURES, SIDES, TOUCH_PARTS, TOUCHED, SurfaceLabels
from physic_testing.conformance.expect import CheckSkipped
from physic_testing.conformance.true_keypoints import true_keypoints_px

if TYPE_CHECKING:
    from physic_core.body import BodyModel
    from physic_core.types import (
        Bodies,
        BodyParameters,
        BoolArray,
        ContactProbability,
        Float64Array,
        FloatArray,
        Keypoints,
    )
    from physic_testing.worlds import World

WRISTS = [JOINT_INDEX[f"{side}_wrist"] for side in SIDES]

_CHILD_YEARS = 12
_CHEST = JOINT_INDEX["spine3"]
_SIDEWAYS = 0.3  # cosine of the chest's direction and the line of sight


def comparable_keypoints(
    answer: Keypoints, world: World
) -> tuple[Keypoints, FloatArray, BoolArray]:
    """Return the detected keypoints that are defined on a body, with the true keypoints.

    Returns:
        Detected keypoints, true points (N, J, 2) px, and whether (N, J) these are visible in the
        photo.

    Raises:
        CheckSkipped: the skeleton is that of a single hand, or has no point on a body.
    """
    keypoints = keypoints_on_body(answer)
    skeleton = keypoints.joint_set
    if "hand21" in skeleton.name or not len(skeleton):
        raise CheckSkipped(f"worlds have no ground truth for the skeleton {skeleton.name!r}")
    return keypoints, *true_keypoints_px(world, skeleton)


def true_observations(world: World) -> dict[str, FloatArray]:
    """Return the fields of ``Observations`` as they are in a world, without shares, NaN where the
    world does not tell.

    ``posture`` is that after which the world is named. Of ``touch``, the answer is the first of
    ``physic_core.types.TOUCHED`` that any vertex of the part does; parts that meet at a joint do
    not touch. ``away`` is NaN from the side.
    """
    sides = [embedded_body().contact_sets[f"{side}_foot"].numpy() for side in SIDES]
    ground = SurfaceLabels(world.touched_surface).ground
    touch = _true_touch(world)
    feet = np.stack([ground[:, foot].any(axis=1) for foot in sides], axis=1)
    turns = turns_from_tpose(world)
    sight = world.joints[:, _CHEST].astype(np.float64)
    facing = (turns[:, _CHEST, :, 2] * sight).sum(1) / np.linalg.norm(sight, axis=1)
    posture = np.array([float(world.name.partition("_")[0] == name) for name in POSTURES])
    return {
        "posture": np.tile(posture if posture.any() else posture * np.nan, (len(touch), 1)),
        "touch": touch,
        "on_floor": np.where(touch[:, :2, 0] > 0, feet, np.nan),
        "child": world.ages < _CHILD_YEARS,
        "away": np.where(np.abs(facing) < _SIDEWAYS, np.nan, facing > 0),
        "head": head_direction(rotations_from_parameters(world.parameters).double()).numpy(),
    }


def _true_touch(world: World) -> FloatArray:
    """Return what each of ``TOUCH_PARTS`` touches, (N, 10, 5) of 0 and 1."""
    names, region = contact_regions(embedded_body())
    apart = np.array([[not are_adjacent(one, other) for other in names] for one in names])
    of_own = apart[region.numpy(), np.maximum(world.touched_own_part, 0)]
    touches = {
        "world": world.contact,
        "object": world.touched_item >= 0,
        "person": world.touched_person >= 0,
        "own body": (world.touched_own_part >= 0) & of_own,
        "nothing": np.ones_like(world.contact),
    }
    order = [TOUCHED.index(name) for name in touches]
    touch = np.zeros((len(world.contact), len(TOUCH_PARTS), len(TOUCHED)))
    for part, row in OBSERVED.items():
        skin = region.numpy() == names.index(part)
        of_part = np.stack([vertices[:, skin].any(axis=1) for vertices in touches.values()], 1)
        touch[np.arange(len(touch)), row, np.take(order, of_part.argmax(axis=1))] = 1
    return touch


def turns_from_tpose(world: World) -> Float64Array:
    """Return the rotations (N, J, 3, 3) of joints from the T-pose to the camera's frame."""
    return rotations_from_tpose(rotations_from_parameters(world.parameters).double().numpy())


def true_hands(world: World) -> FloatArray:
    """Return the true finger rotations (N, 2, 15, 3) as rotation vectors, left hand first."""
    truth = world.parameters
    both: FloatArray = np.stack([truth.left_hand_pose, truth.right_hand_pose], axis=1)
    return both.reshape(-1, 2, 15, 3)


def true_wrists(world: World) -> FloatArray:
    """Return the true hand rotations (N, 2, 3) from T-pose to camera frame as rotation vectors,
    left first.
    """
    return rotmat_to_rotvec(turns_from_tpose(world)[:, WRISTS])


def rotation_errors_deg(rotvecs: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the angles (...), degrees, between estimated and true rotations, rotation vectors
    (..., 3) in radians.
    """
    one, other = (rotvec_to_rotmat_numpy(each.astype(np.float64)) for each in (rotvecs, truth))
    turns = rotmat_to_rotvec(one.swapaxes(-1, -2) @ other)
    return np.asarray(np.degrees(np.linalg.norm(turns, axis=-1)))


def embedded_surface(bodies: Bodies) -> tuple[FloatArray, FloatArray]:
    """Return vertices (N, V, 3) and joints (N, 55, 3) of the embedded body, camera frame, m.

    Bodies of another model are converted first, as the pipeline does.

    Raises:
        CheckSkipped: the model of these bodies is a file of the user.
    """
    import torch

    with torch.no_grad():
        out = embedded_body()(*pose_from_parameters(embedded_parameters(bodies))[:3])
    return out.vertices.double().numpy(), out.joints.double().numpy()


@lru_cache(maxsize=1)
def embedded_body() -> BodyModel:
    """Load the body model "embedded"; the model is cached."""
    return load_body("embedded")


def embedded_parameters(bodies: Bodies) -> BodyParameters:
    """Convert bodies to the embedded body, and return their parameters.

    Raises:
        CheckSkipped: the model of these bodies is a file of the user, and they cannot be converted.
    """
    model = embedded_body()
    if not can_convert(bodies, model):
        raise CheckSkipped(
            f"the body model {bodies.body_model!r} is not installed, and the bodies have no "
            f"joints or mesh to convert"
        )
    return convert_bodies(bodies, model).bodies.parameters


def contact_on_embedded(answer: ContactProbability) -> ContactProbability:
    """Transfer contact probabilities to the mesh of the embedded body, (N, V)."""
    return convert_contact(answer, embedded_body())
