"""How outputs of a BodyEstimator are compared: places, distances, orientation and pose of
bodies.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body import JOINT_NAMES
from physic_core.geometry import rotmat_to_rotvec, rotvec_to_rotmat_numpy
from physic_core.types import mirrored_order
from physic_testing.conformance.changes import WITHOUT_HINTS
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import expect
from physic_testing.conformance.known_mistakes import (
    Group,
    KnownMistake,
    Table,
    normalised,
    plus,
    reordered,
    search_order,
    times,
)
from physic_testing.conformance.output_checks import ROWS, WITHOUT_PEOPLE
from physic_testing.conformance.truth import (
    embedded_body,
    embedded_parameters,
    embedded_surface,
)
from physic_testing.metrics import mpjpe_mm

if TYPE_CHECKING:
    from physic_core.types import Bodies, BodyParameters, FloatArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case, Truth, Values

MIRROR = np.array([-1.0, 1.0, 1.0])
"""Factors of a point whose mirror is the plane x = 0; those of a rotation vector are the
opposite.
"""

MAX_JOINT_TO_MESH_M = 0.5
_KNOWN = ("embedded", "smplx")
_BODY = 22
"""Number of joints without face and fingers."""

_SIDES = mirrored_order(JOINT_NAMES[:_BODY])
_POSE_SIDES = mirrored_order(JOINT_NAMES[1:_BODY])
_MIRRORED = "Was the photo mirrored for the network, and the body not mirrored back?"

_FOCAL = (
    "Is it the focal length of the crop, or of the network? z is the focal length of the photo in "
    "px / px per meter, in px of the photo: multiply the network's output by "
    "the side of the crop. "
    "z is positive in front of an OpenCV camera: turn bodies of an OpenGL camera."
)

_DEGREES = "Are they in degrees?"
_TURNED_CROP = "A crop beside the image's center is seen by a rotated camera: rotate bodies back."


def shortest(rotvecs: FloatArray) -> FloatArray:
    """Return the rotation vectors (..., 3) of the same rotations whose length is at most pi, NaN
    where these are.
    """
    return rotmat_to_rotvec(rotvec_to_rotmat_numpy(np.asarray(rotvecs, np.float64)))


def as_matrices(rotvecs: FloatArray, truth: Truth) -> list[FloatArray]:
    """Return the rotation matrices of each row of rotation vectors, NaN where these are."""
    return [row.ravel() for row in rotvec_to_rotmat_numpy(np.asarray(rotvecs, np.float64))]


def _values(answer: Bodies, case: Case) -> tuple[Values, Truth]:
    """Return the pelvis (N, 3) and the joints from it (N, 22, 3), m, log of the stature (N, 1), m,
    rotation vectors of the root (N, 3) and of the joints (N, 21, 3), and which joints are visible.
    """
    world = case.truth
    values = _values_of_parts(embedded_surface(answer)[1], embedded_parameters(answer))
    truth = _values_of_parts(world.joints.astype(np.float64), world.parameters)
    truth["observed"] = world.joints_visible[:, :_BODY].astype(float)
    values["observed"] = truth["observed"] * np.nan
    if answer.observed is not None:
        values["observed"] = answer.observed[:, :_BODY].astype(float)
    return values, truth


def _values_of_parts(joints: FloatArray, parameters: BodyParameters) -> Values:
    import torch

    with torch.no_grad():
        stature = embedded_body().stature(torch.tensor(parameters.betas, dtype=torch.float32))
    return {
        "pelvis": joints[:, 0],
        "limbs": joints[:, :_BODY] - joints[:, :1],
        "stature": np.log(stature.double().numpy())[:, None],
        "root": shortest(parameters.global_orient),
        "pose": shortest(parameters.body_pose.reshape(len(parameters), -1, 3)),
    }


def _errors(values: Values, truth: Truth) -> dict[str, Any]:
    joints = [side["limbs"] + side["pelvis"][:, None] for side in (values, truth)]
    return {"MPJPE, mm": mpjpe_mm(*joints)}


def _across(pelvis: FloatArray, truth: Truth) -> list[FloatArray]:
    """Return the mean place of the people of a photo across the line of sight, m at their true
    distance.
    """
    with np.errstate(all="ignore"):
        beside = pelvis[:, :2] / pelvis[:, 2:] * truth["pelvis"][:, 2:]
    return [np.mean([at for at in beside if np.isfinite(at).all()] or [np.full(2, np.nan)], 0)]


def _log_distance(pelvis: FloatArray, truth: Truth) -> list[FloatArray]:
    return list(np.log(np.maximum(pelvis[:, 2:], 1e-6) / truth["pelvis"][:, 2:]))


def _turned(rotvecs: FloatArray, by: FloatArray) -> FloatArray:
    """Return rotation vectors (N, 3) after further turns about axes of the camera."""
    from scipy.spatial.transform import Rotation

    turned: FloatArray = (Rotation.from_rotvec(by) * Rotation.from_rotvec(rotvecs)).as_rotvec()
    return turned


def _euler(rotvecs: FloatArray, truth: Truth) -> FloatArray:
    """Return the angles of rotations about x, y and z."""
    from scipy.spatial.transform import Rotation

    angles = Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_euler("xyz")
    return np.asarray(angles.reshape(rotvecs.shape))


def _of_crop(root: FloatArray, truth: Truth) -> FloatArray:
    """Return the orientation that a camera sees which looks at the person."""
    x, y, z = truth["pelvis"].T
    aside = np.hypot(x, y)
    angle = np.arctan2(aside, z) / np.maximum(aside, 1e-9)
    return _turned(root, np.stack([y * angle, -x * angle, 0 * x], axis=1))


_EULER = "Are they Euler angles? Convert them to rotation vectors."
FORMS = (
    KnownMistake("inverse", times(-1), "Is the matrix transposed?"),
    KnownMistake("Euler angles", _euler, _EULER),
    KnownMistake("in degrees", times(180 / np.pi), _DEGREES),
)
"""Readings of rotations that are stored in another form."""


def _about(axis: int, name: str) -> KnownMistake:
    """Return the reading of bodies that are turned about an axis of the camera."""
    by = np.radians(12) * np.eye(3)[axis]
    words = f"degrees about {name}"
    return KnownMistake(words, lambda root, _: _turned(root, by), _TURNED_CROP, 12, "", 6)


def check_bodies_can_be_posed(subject: BackendUnderTest) -> None:
    """`body_model` is known, with matching betas, or the bodies have joints or a mesh that suffice
    for a conversion.
    """
    from physic_core.conversion import can_convert

    bodies = subject.result()
    parameters = bodies.parameters
    model = embedded_body()
    expect(
        can_convert(bodies, model) or bodies.body_model in _KNOWN,
        f"a body_model in {', '.join(_KNOWN)}, or SMPL-X joints, or a mesh with its T-pose",
        f"{bodies.body_model!r} without joints or mesh",
    )
    carried = embedded_parameters(bodies).transl
    is_lost = np.isnan(carried[:, 0]) & np.isfinite(parameters.transl[:, 0])
    expect(
        not is_lost.any(),
        "known joints of both hips, and of both shoulders or the neck",
        f"{int(is_lost.sum())} of {len(carried)} bodies lack them",
        "Joints are in the order of SMPL-X, NaN where unknown.",
    )
    if bodies.mesh is not None and bodies.joints is not None:
        middles = bodies.mesh.vertices.mean(axis=1), np.nanmean(bodies.joints, axis=1)
        apart = np.linalg.norm(middles[0] - middles[1], axis=1).max()
        expect(
            apart < MAX_JOINT_TO_MESH_M,
            f"joints within {MAX_JOINT_TO_MESH_M} m of the mesh, from middle to middle",
            f"joints {apart:.3g} m away",
            "Are both in meters, and in the camera's frame?",
        )


_TRANSL = (
    "transl is added after posing; it is the place of the pelvis only where that is the "
    "origin at rest."
)

_PLACE = (
    KnownMistake("to the right", plus(0.1, 0, 0), _TRANSL, 0.1, " m", 0.05),
    KnownMistake("down", plus(0, 0.1, 0), _TRANSL, 0.1, " m", 0.05),
)

_LARGE = float(np.log(1.2))
_FAR = (KnownMistake("too far", times(np.e), _FOCAL, 1, " of the logarithm", _LARGE),)


def _reading_of_factor(words: str, factor: Callable[[Case], Any]) -> KnownMistake:
    """Return the reading of places that are multiplied by something of the photo."""
    return KnownMistake(
        f"times {words}", lambda at, truth: at * factor(truth["case"]), _FOCAL, 1, "", 0.5
    )


_CROP = (
    _reading_of_factor("the side of the person's box", lambda case: case.box_sides[:, None]),
    _reading_of_factor("the focal length", lambda case: case.intrinsics.fx),
)

_DOWN = "y is down in the camera's frame."

_LIMBS = (
    KnownMistake("mirrored", lambda limbs, _: limbs[:, _SIDES] * MIRROR, _MIRRORED),
    KnownMistake("with left and right limbs exchanged", reordered(_SIDES), _MIRRORED),
    KnownMistake("turned upside down", times(1, -1, -1), _DOWN),
)

_ROOT = (
    *FORMS,
    KnownMistake("of the camera of a crop that looks at the person", _of_crop, _TURNED_CROP),
    *(_about(*axis) for axis in enumerate("xyz")),
)

_TALL = "Are betas those of this body model, in its order and unit?"
_REST = "Is it a pose at rest for every photo?"

_POSE = (
    KnownMistake("at rest in every photo", times(0), _REST, limit=0.75),
    *FORMS,
    KnownMistake(
        "a mean of left and right, as of a mirrored photo",
        lambda pose, _: (pose + pose[:, _POSE_SIDES]) / 2,
        _MIRRORED,
    ),
    KnownMistake(
        "of the mirrored person", lambda pose, _: -MIRROR * pose[:, _POSE_SIDES], _MIRRORED
    ),
)

_GROUPS = (
    Group(
        "bodies_are_in_place",
        "bodies where people are in the photo",
        "pelvis",
        "m",
        _PLACE,
        _across,
        rough=0.75,
    ),
    Group(
        "bodies_are_as_far_away",
        "bodies as far away as people in the photo, m",
        "pelvis",
        "of log distance",
        _FAR,
        _log_distance,
        rough=float(np.log(3)),
    ),
    Group(
        "distance_does_not_depend_on_the_crop",
        "distances in one ratio to the true ones",
        "pelvis",
        "of log distance",
        _CROP,
        _log_distance,
        centred=True,
        after=("bodies_are_as_far_away",),
    ),
    Group(
        "bodies_are_as_tall",
        "bodies of the statures of people",
        "stature",
        "of log stature",
        (KnownMistake("too tall", plus(0.1), _TALL, 10, " %", 12),),
        rough=_LARGE,
    ),
    Group(
        "observed_is_true_in_sight",
        "True for visible joints, and False for hidden ones",
        "observed",
        "of a unit vector",
        (KnownMistake("inverted", lambda seen, _: 1 - seen, "True is visible."),),
        normalised,
        is_telling=True,
    ),
    Group(
        "pose_is_not_turned_or_mirrored",
        "bodies upright, facing and with their sides as in the photo",
        "limbs",
        "m",
        _LIMBS,
        search=search_order(JOINT_NAMES[:_BODY], 1),
    ),
    Group(
        "bodies_face_the_right_way",
        "orientations in the camera's frame",
        "root",
        "of a rotation matrix",
        _ROOT,
        as_matrices,
    ),
    Group(
        "joints_turn_as_in_the_photo",
        "rotations of joints to their parents, in the order of SMPL-X",
        "pose",
        "of a rotation matrix",
        _POSE,
        as_matrices,
        search=search_order(JOINT_NAMES[1:_BODY], 1),
        after=("pose_is_not_turned_or_mirrored",),
    ),
)

TABLE = Table(
    _values,
    _errors,
    (
        WITHOUT_PEOPLE,
        WITHOUT_HINTS,
        Check(check_bodies_can_be_posed),
        *ROWS,
    ),
    _GROUPS,
    after=("bodies_can_be_posed",),
)
