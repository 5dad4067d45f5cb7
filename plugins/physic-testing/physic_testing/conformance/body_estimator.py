"""How outputs of a BodyEstimator are compared: places, distances, orientation and pose of
bodies.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body.joints import JOINT_NAMES
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.output_checks import HINT_CHECKS, PEOPLE_CHECKS, ROW_CHECKS
from physic_testing.conformance.readings import Group, Reading, Table, changed
from physic_testing.conformance.truth import (
    embedded_body,
    embedded_surface,
    mirrored_order,
    model_of,
    parameters_of_model,
)

if TYPE_CHECKING:
    from physic_core.types import Bodies, FloatArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case
    from physic_testing.conformance.readings import Make, Values

MIRROR = np.array([-1.0, 1.0, 1.0])
"""Factors of a point whose mirror is the plane x = 0."""

MAX_JOINT_TO_MESH_M = 0.1
_KNOWN = ("embedded", "smplx")
_BODY = 22
"""Number of joints without face and fingers."""

_SIDES = mirrored_order(JOINT_NAMES[:_BODY])
_POSE_SIDES = mirrored_order(JOINT_NAMES[1:_BODY])
_ROTATIONS = (
    "global_orient",
    "body_pose",
    "left_hand_pose",
    "right_hand_pose",
    "jaw_pose",
    "leye_pose",
    "reye_pose",
)


def matrices(rotvecs: FloatArray) -> FloatArray:
    """Return rotation matrices (..., 3, 3) of rotation vectors (..., 3), NaN where these are."""
    from scipy.spatial.transform import Rotation

    flat = np.asarray(rotvecs, np.float64).reshape(-1, 3)
    found: FloatArray = Rotation.from_rotvec(np.nan_to_num(flat)).as_matrix()
    found[~np.isfinite(flat).all(axis=1)] = np.nan
    return found.reshape(*rotvecs.shape[:-1], 3, 3)


def rotvecs(rotations: FloatArray) -> FloatArray:
    """Return rotation vectors (..., 3) of rotation matrices (..., 3, 3), NaN where these are."""
    return _of_rotations(rotations, lambda turn: turn.as_rotvec())


def euler(rotations: FloatArray) -> FloatArray:
    """Return the rotations whose rotation vectors are the angles of others about x, y and z."""
    return matrices(_of_rotations(rotations, lambda turn: turn.as_euler("xyz")))


def degrees(rotations: FloatArray) -> FloatArray:
    """Return the rotations whose rotation vectors are those of others in degrees."""
    return matrices(np.degrees(rotvecs(rotations)))


def inverse(rotations: FloatArray) -> FloatArray:
    """Return inverse rotations (..., 3, 3)."""
    return np.swapaxes(rotations, -1, -2)


def at_rest(rotations: FloatArray) -> FloatArray:
    """Return no rotations (..., 3, 3)."""
    return np.broadcast_to(np.eye(3), rotations.shape)


def mirrored(rotations: FloatArray) -> FloatArray:
    """Return the rotations (..., 3, 3) of the mirrored joints."""
    return np.diag(MIRROR) @ rotations @ np.diag(MIRROR)


def _of_rotations(rotations: FloatArray, read: Callable[[Any], FloatArray]) -> FloatArray:
    from scipy.spatial.transform import Rotation

    flat = rotations.reshape(-1, 3, 3)
    known = np.isfinite(flat).all(axis=(1, 2))
    found = np.full((len(flat), 3), np.nan)
    if known.any():
        found[known] = read(Rotation.from_matrix(flat[known]))
    return found.reshape(*rotations.shape[:-2], 3)


def _values(answer: Bodies, case: Case, truth: Values) -> Values:
    given = parameters_of_model(answer)
    return {
        "joints": embedded_surface(answer)[1][:, :_BODY],
        "root": matrices(given.global_orient),
        "pose": matrices(given.body_pose.reshape(len(given), -1, 3)),
    }


def _truth(answer: Bodies, case: Case) -> Values:
    world = case.truth
    true = world.parameters
    return {
        "joints": world.joints[:, :_BODY].astype(np.float64),
        "root": matrices(true.global_orient),
        "pose": matrices(true.body_pose.reshape(len(true), -1, 3)),
    }


def _across(values: Values, truth: Values, case: Case) -> list[FloatArray]:
    """Return the mean place of the people of a photo across the line of sight, m at their true
    distance.
    """
    at = values["joints"][:, 0]
    place = truth["joints"][:, 0]
    with np.errstate(all="ignore"):
        beside = at[:, :2] / at[:, 2:] * place[:, 2:]
    known = np.isfinite(beside).all(axis=1)
    return [beside[known].mean(axis=0) if known.any() else np.full(2, np.nan)]


def _distance(values: Values, truth: Values, case: Case) -> list[FloatArray]:
    logs = np.log(np.maximum(np.linalg.norm(values["joints"][:, 0], axis=1), 1e-6))
    return [
        np.array([value]) for value in logs - np.log(np.linalg.norm(truth["joints"][:, 0], axis=1))
    ]


def _joints(values: Values, truth: Values, case: Case) -> list[FloatArray]:
    return [person.ravel() for person in values["joints"] - values["joints"][:, :1]]


def _each(key: str) -> Callable[[Values, Values, Case], list[FloatArray]]:
    return lambda values, truth, case: [person.ravel() for person in values[key]]


def _placed(change: Callable[[FloatArray], FloatArray]) -> Make:
    return changed(joints=lambda joints: joints + change(joints[:, :1]) - joints[:, :1])


def _about_pelvis(change: Callable[[FloatArray], FloatArray]) -> Make:
    return changed(joints=lambda joints: joints[:, :1] + change(joints - joints[:, :1]))


def _of_crop(values: Values, case: Case) -> Values:
    """Return the orientation that a camera sees which looks at the person."""
    ray = values["joints"][:, 0] / np.linalg.norm(values["joints"][:, 0], axis=1, keepdims=True)
    axis = np.stack([-ray[:, 1], ray[:, 0], 0 * ray[:, 0]], axis=1)
    long = np.linalg.norm(axis, axis=1, keepdims=True)
    turn = matrices(-axis / np.maximum(long, 1e-9) * np.arcsin(np.clip(long, 0, 1)))
    return values | {"root": turn @ values["root"]}


def _by(values: Values, factor: FloatArray | float) -> Values:
    return values | {"joints": values["joints"] * np.reshape(factor, (-1, 1, 1))}


def _sides(case: Case) -> FloatArray:
    return np.asarray((case.people.boxes[:, 2:] - case.people.boxes[:, :2]).max(axis=1))


_MIRRORED = "Was the photo mirrored for the network, and the body not mirrored back?"
_FOCAL = (
    "Is it the focal length of the crop, or of the network? z is the focal length of the photo in "
    "px / px per metre, "
    "in px of the photo: scale what the network says of a crop by the side of the crop."
)
_TRANSL = (
    "transl is added after posing; it is the place of the pelvis only where that is the "
    "origin at rest."
)
_DEGREES = "Are they in degrees?"
_TURNED = "A crop beside the image's centre is seen by a rotated camera: rotate bodies back."


def turns(key: str) -> tuple[Reading, ...]:
    """Return the readings of rotations that are stored in another form."""
    return (
        Reading("inverse", changed(**{key: inverse}), "Is the matrix transposed?"),
        Reading(
            "Euler angles",
            changed(**{key: euler}),
            "Are they Euler angles? Convert them to rotation vectors.",
        ),
        Reading("in degrees", changed(**{key: degrees}), _DEGREES),
    )


def _mean_of_sides(pose: FloatArray) -> FloatArray:
    return matrices((rotvecs(pose) + rotvecs(pose)[:, _POSE_SIDES]) / 2)


def _turned(axis: int) -> Make:
    return changed(root=lambda root: matrices(np.radians(12) * np.eye(3)[axis]) @ root)


_LARGE = float(np.log(1.2))
_PLACE = (
    Reading(
        "to the right", _placed(lambda at: at + np.array([0.1, 0, 0])), _TRANSL, 0.1, " m", 0.05
    ),
    Reading("down", _placed(lambda at: at + np.array([0, 0.1, 0])), _TRANSL, 0.1, " m", 0.05),
)
_FAR = (
    Reading("too far", _placed(lambda at: np.e * at), _FOCAL, 1.0, " of the logarithm", _LARGE),
)
_CROP = (
    Reading(
        "times the side of the person's box",
        lambda v, case: _by(v, _sides(case)),
        _FOCAL,
        1.0,
        "",
        0.5,
    ),
    Reading(
        "times the focal length", lambda v, case: _by(v, case.intrinsics.fx), _FOCAL, 1.0, "", 0.5
    ),
)
_UPRIGHT = (
    Reading("mirrored", _about_pelvis(lambda j: j[:, _SIDES] * MIRROR), _MIRRORED),
    Reading(
        "with left and right limbs exchanged", _about_pelvis(lambda j: j[:, _SIDES]), _MIRRORED
    ),
    Reading(
        "turned upside down",
        _about_pelvis(lambda j: j * [1, -1, -1]),
        "y is down in the camera's frame.",
    ),
)
_ROOT = (
    *turns("root"),
    Reading("of the camera of a crop that looks at the person", _of_crop, _TURNED),
    *(
        Reading(f"degrees about {name}", _turned(i), _TURNED, 12.0, "", 6.0)
        for i, name in enumerate("xyz")
    ),
)
_POSE = (
    Reading(
        "at rest in every photo",
        changed(pose=at_rest),
        "Is it a pose at rest for every photo?",
        limit=0.75,
    ),
    *turns("pose"),
    Reading(
        "a mean of left and right, as of a mirrored photo", changed(pose=_mean_of_sides), _MIRRORED
    ),
    Reading(
        "of the mirrored person", changed(pose=lambda p: mirrored(p)[:, _POSE_SIDES]), _MIRRORED
    ),
    Reading("with left and right exchanged", changed(pose=lambda p: p[:, _POSE_SIDES]), _MIRRORED),
)
_TURNS = "of a rotation matrix"
_GROUPS = (
    Group(
        "bodies_are_in_place",
        "bodies where people are in the photo",
        "m",
        _across,
        _PLACE,
        rough=0.75,
    ),
    Group(
        "bodies_are_as_far_away",
        "bodies as far away as people in the photo, m",
        "of log distance",
        _distance,
        _FAR,
        rough=float(np.log(3)),
        after=("bodies_are_in_front",),
    ),
    Group(
        "distance_does_not_depend_on_the_crop",
        "distances in one ratio to the true ones",
        "of log distance",
        _distance,
        _CROP,
        centred=True,
        after=("bodies_are_as_far_away",),
    ),
    Group(
        "pose_is_not_turned_or_mirrored",
        "bodies upright, facing and with their sides as in the photo",
        "m",
        _joints,
        _UPRIGHT,
        order=("joints", JOINT_NAMES[:_BODY], 1),
    ),
    Group(
        "bodies_face_the_right_way",
        "orientations in the camera's frame",
        _TURNS,
        _each("root"),
        _ROOT,
    ),
    Group(
        "joints_turn_as_in_the_photo",
        "rotations of joints to their parents, in the order of SMPL-X",
        _TURNS,
        _each("pose"),
        _POSE,
        order=("pose", JOINT_NAMES[1:_BODY], 1),
        after=("pose_is_not_turned_or_mirrored",),
    ),
)
_FORM = ("bodies_can_be_posed",)
TABLE = Table(
    _values,
    _truth,
    _GROUPS,
    "physic_core.types.Bodies",
    _FORM,
)


def check_bodies_can_be_posed(subject: BackendUnderTest) -> None:
    """`body_model` is known, with matching betas, or the bodies have joints or a mesh that suffice
    for a conversion; rotation vectors are in radians.
    """
    from physic_core.body.convert.bodies import can_convert

    bodies = subject.result()
    parameters = bodies.parameters
    for name in _ROTATIONS:
        expect_radians(getattr(parameters, name), f" in {name}")
    convertible = can_convert(bodies, embedded_body())
    expect(
        convertible or bodies.body_model in _KNOWN,
        f"a body_model in {', '.join(_KNOWN)}, or SMPL-X joints, or a mesh with its T-pose",
        f"{bodies.body_model!r} without joints or mesh",
    )
    if not convertible or bodies.body_model == "embedded":
        model = model_of(bodies)
        counts = parameters.betas.shape[1], parameters.expression.shape[1]
        expect(
            counts == (model.num_betas, model.num_expression),
            f"{model.num_betas} betas and {model.num_expression} components of expression",
            f"{counts}",
        )
    carried = parameters_of_model(bodies).transl
    lost = np.isnan(carried[:, 0]) & np.isfinite(parameters.transl[:, 0])
    expect(
        not lost.any(),
        "known joints of both hips, and of both shoulders or the neck",
        f"{int(lost.sum())} of {len(carried)} bodies lack them",
        "Joints are in the order of SMPL-X, NaN where unknown.",
    )
    if bodies.mesh is not None and bodies.joints is not None:
        low = bodies.mesh.vertices.min(axis=1)[:, None]
        high = bodies.mesh.vertices.max(axis=1)[:, None]
        beyond = np.maximum(low - bodies.joints, bodies.joints - high)
        worst = float(np.nanmax(beyond, initial=-np.inf))
        expect(
            worst < MAX_JOINT_TO_MESH_M,
            f"joints at most {MAX_JOINT_TO_MESH_M} m outside of the mesh",
            f"a joint {worst:.3g} m outside",
            "Are both in metres, and in the camera's frame?",
        )


def expect_radians(vectors: FloatArray, where: str = "") -> None:
    """Raise CheckFailed if a rotation vector (..., 3) is longer than 2 pi."""
    longest = float(np.linalg.norm(vectors.reshape(-1, 3), axis=1).max(initial=0))
    wanted = f"rotation vectors in radians, at most 6.28 long{where}"
    expect(longest < 2 * np.pi + 0.01, wanted, f"{longest:.1f}", _DEGREES)


def check_bodies_are_in_front(subject: BackendUnderTest) -> None:
    """The pelvis is in front of the camera: z is positive."""
    z = embedded_surface(subject.result())[1][:, 0, 2]
    expect(
        bool((z > 0).all()),
        "a pelvis in front of the camera, z > 0 (OpenCV: x right, y down, z forward)",
        f"z = {np.round(z, 2).tolist()} m",
        "Rotate bodies of an OpenGL camera by 180 degrees about x.",
    )


def check_observed_is_true_in_sight(subject: BackendUnderTest) -> None:
    """`observed`, if given, is more often True for joints in sight than for hidden ones."""
    more = []
    for case, bodies in subject.evidence():
        if bodies.observed is None:
            raise CheckSkipped("it returns no `observed`")
        own = bodies.observed[:, :_BODY]
        seen = case.truth.joints_visible[:, :_BODY]
        if not seen.all():
            more.append(float(own[seen].mean() - own[~seen].mean()))
    expect(
        float(np.mean(more)) > 0,
        "True for joints in sight, and False for hidden ones",
        f"{np.mean(more):+.0%} more True values in sight",
        "Is it inverted, or True for all joints? Return None if the network does not tell.",
    )


_READ = TABLE.read
CHECKS: tuple[Check, ...] = (
    *PEOPLE_CHECKS,
    *HINT_CHECKS,
    Check(check_bodies_can_be_posed, _READ),
    Check(check_bodies_are_in_front, "physic_core.types.BodyParameters", after=_FORM),
    Check(check_observed_is_true_in_sight, _READ, unless=BLIND),
    *ROW_CHECKS,
)
"""Further checks of a BodyEstimator, in order of execution."""
