"""Conversion of ground truth and backend results to a common form for comparison."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import JOINT_INDEX
from physic_core.engine.body_parts import OBSERVED, are_adjacent, contact_regions
from physic_core.types import POSTURES, SIDES, TOUCH_PARTS, TOUCHED, SurfaceLabels
from physic_testing.conformance.expect import CheckSkipped

if TYPE_CHECKING:
    from physic_core.body import BodyModel
    from physic_core.types import (
        Bodies,
        BodyParameters,
        BoolArray,
        ContactProbability,
        FloatArray,
        Keypoints,
    )
    from physic_testing.worlds import World

_CHILD_YEARS = 12
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
    from physic_core.body import keypoints_on_body
    from physic_testing.conformance.true_keypoints import true_keypoints_px

    known = keypoints_on_body(answer)
    skeleton = known.joint_set
    if "hand21" in skeleton.name or not len(skeleton):
        raise CheckSkipped(f"worlds have no ground truth for the skeleton {skeleton.name!r}")
    return known, *true_keypoints_px(world, skeleton)


def true_touch(world: World) -> BoolArray:
    """Return which of ``physic_core.types.TOUCHED`` each of ``TOUCH_PARTS`` touches: (N, 10, 5)
    bool, the first of world, object, person and another part of the own body that any vertex does,
    or nothing. Parts that meet at a joint do not count.
    """
    names, region = contact_regions(embedded_body())
    apart = np.array([[not are_adjacent(one, other) for other in names] for one in names])
    of_own = apart[region.numpy(), np.maximum(world.touched_own_part, 0)]
    touches = {
        "world": world.contact,
        "object": world.touched_item >= 0,
        "person": world.touched_person >= 0,
        "own body": (world.touched_own_part >= 0) & of_own,
    }
    found = np.zeros((len(world.contact), len(TOUCH_PARTS), len(TOUCHED)), bool)
    for part, row in OBSERVED.items():
        skin = region.numpy() == names.index(part)
        left = np.ones(len(found), bool)
        for name, vertices in touches.items():
            found[:, row, TOUCHED.index(name)] = own = left & vertices[:, skin].any(1)
            left = left & ~own
        found[:, row, TOUCHED.index("nothing")] = left
    return found


def true_head(world: World) -> FloatArray:
    """Return the directions (N, 3) in which faces look, unit vectors in the camera frame."""
    from physic_core.body import head_direction, rotations_from_parameters

    return head_direction(rotations_from_parameters(world.parameters).double()).numpy()


def true_posture(world: World) -> FloatArray:
    """Return which of ``physic_core.types.POSTURES`` (N, 9) people have: that after which the world
    is named, else NaN.
    """
    name = world.name.partition("_")[0]
    known = np.array([float(name == posture) for posture in POSTURES])
    return np.tile(known if name in POSTURES else known * np.nan, (len(world.ages), 1))


def true_child(world: World) -> BoolArray:
    """Return which people (N,) are children."""
    return np.asarray(world.ages < _CHILD_YEARS)


def true_away(world: World) -> FloatArray:
    """Return which people (N,) turn the back to the camera; NaN from the side."""
    from physic_core.body import rotations_from_parameters, rotations_from_tpose

    turns = rotations_from_tpose(rotations_from_parameters(world.parameters).double().numpy())
    at = world.joints[:, JOINT_INDEX["spine3"]].astype(np.float64)
    sight = at / np.linalg.norm(at, axis=1, keepdims=True)
    facing = (turns[:, JOINT_INDEX["spine3"], :, 2] * sight).sum(1)
    return np.where(np.abs(facing) < _SIDEWAYS, np.nan, facing > 0)


def true_feet_on_floor(world: World) -> BoolArray:
    """Return which feet (N, 2) touch the floor or the ground."""
    sets = embedded_body().contact_sets
    ground = SurfaceLabels(world.touched_surface).ground
    return np.stack([ground[:, sets[f"{side}_foot"].numpy()].any(1) for side in SIDES], 1)


def true_hands(world: World) -> FloatArray:
    """Return the true finger rotations (N, 2, 15, 3) as rotation vectors, left hand first."""
    truth = world.parameters
    both: FloatArray = np.stack([truth.left_hand_pose, truth.right_hand_pose], axis=1).reshape(
        -1, 2, 15, 3
    )
    return both


def true_wrists(world: World) -> FloatArray:
    """Return the true hand rotations (N, 2, 3) from T-pose to camera frame as rotation vectors,
    left first.
    """
    from physic_core.body import rotations_from_parameters, rotations_from_tpose
    from physic_core.geometry import rotmat_to_rotvec

    turns = rotations_from_tpose(rotations_from_parameters(world.parameters).double().numpy())
    wrists: FloatArray = rotmat_to_rotvec(
        turns[:, [JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]]]
    )
    return wrists


def rotation_errors_deg(rotvecs: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the angles (...), degrees, between estimated and true rotations, rotation vectors
    (..., 3) in radians.
    """
    from scipy.spatial.transform import Rotation

    first, second = (
        Rotation.from_rotvec(r.reshape(-1, 3).astype(np.float64)) for r in (rotvecs, truth)
    )
    angles: FloatArray = np.degrees((first.inv() * second).magnitude()).reshape(rotvecs.shape[:-1])
    return angles


def embedded_surface(bodies: Bodies) -> tuple[FloatArray, FloatArray]:
    """Return vertices (N, V, 3) and joints (N, 55, 3) of the embedded body, camera frame, m.

    Bodies of another model are converted first, as the pipeline does.

    Raises:
        CheckSkipped: the model of these bodies is a file of the user.
    """
    import torch

    from physic_core.body import pose_from_parameters

    with torch.no_grad():
        out = embedded_body()(*pose_from_parameters(embedded_parameters(bodies))[:3])
    return out.vertices.double().numpy(), out.joints.double().numpy()


@lru_cache(maxsize=1)
def embedded_body() -> BodyModel:
    """Load the body model "embedded"; the model is cached."""
    from physic_core.body import load_body

    return load_body("embedded")


def embedded_parameters(bodies: Bodies) -> BodyParameters:
    """Convert bodies to the embedded body, and return their parameters.

    Raises:
        CheckSkipped: the model of these bodies is a file of the user, and they cannot be converted.
    """
    from physic_core.conversion import can_convert, convert_bodies

    model = embedded_body()
    if not can_convert(bodies, model):
        raise CheckSkipped(
            f"the body model {bodies.body_model!r} is not installed, and the bodies have no "
            f"joints or mesh to convert"
        )
    return convert_bodies(bodies, model).bodies.parameters


def contact_on_embedded(answer: ContactProbability) -> ContactProbability:
    """Transfer contact probabilities to the mesh of the embedded body, (N, V)."""
    from physic_core.conversion import convert_contact

    return convert_contact(answer, embedded_body())
