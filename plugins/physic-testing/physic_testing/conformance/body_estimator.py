"""Checks of a BodyEstimator: body model, units, camera frame, position, orientation and left-right order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import expect
from physic_testing.conformance.output_checks import HINT_CHECKS, PEOPLE_CHECKS
from physic_testing.conformance.row_order import check_rows_follow_the_people
from physic_testing.conformance.truth import embedded_body, mirrored_order, model_of, posed_bodies

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Intrinsics
    from physic_testing.conformance.backend_under_test import BackendUnderTest

__all__ = ["CHECKS"]

MAX_FACTOR = 3.0
MIN_INSIDE, MARGIN = 0.6, 0.25
MAX_TURN_DEG = 60.0
MAX_JOINT_TO_MESH_M = 0.1
_KNOWN = ("embedded", "smplx")
_ROTATIONS = ("global_orient", "body_pose", "left_hand_pose", "right_hand_pose", "jaw_pose", "leye_pose", "reye_pose")


def check_body_model_is_known(subject: BackendUnderTest) -> None:
    """`body_model` is known, with matching betas and expression, or the bodies have joints or a mesh."""
    from physic_core.body.conversion import can_convert

    bodies = subject.result()
    convertible = can_convert(bodies, embedded_body())
    expect(
        convertible or bodies.body_model in _KNOWN,
        f"a body_model in {', '.join(_KNOWN)}, or SMPL-X joints, or a mesh with its T-pose",
        f"{bodies.body_model!r} without joints or mesh",
    )
    if convertible and bodies.body_model != "embedded":
        return
    model, parameters = model_of(bodies), bodies.parameters
    for name, wanted in (("betas", model.num_betas), ("expression", model.num_expression)):
        count = getattr(parameters, name).shape[1]
        expect(count == wanted, f"{name} of {wanted} components for the body {bodies.body_model!r}", f"{count}")


def check_angles_are_radians(subject: BackendUnderTest) -> None:
    """Rotation vectors are in radians: no vector is longer than 2 pi."""
    parameters = subject.result().parameters
    for name in _ROTATIONS:
        longest = _longest(getattr(parameters, name))
        expect(
            longest < 2 * np.pi + 0.01, f"rotation vectors in radians, at most 6.28 long, in {name}", f"{longest:.1f}"
        )


def check_joints_suffice_to_convert_bodies(subject: BackendUnderTest) -> None:
    """Joints of another body model include both hips, and both shoulders or the neck, for the conversion."""
    from physic_core.body.conversion import convert_bodies

    bodies = subject.result()
    carried = convert_bodies(bodies, model_of(bodies)).parameters.transl
    lost = np.isnan(carried[:, 0]) & np.isfinite(bodies.parameters.transl[:, 0])
    expect(
        not lost.any(),
        "known joints of both hips, and of both shoulders or the neck",
        f"{int(lost.sum())} of {len(carried)} bodies lack them",
        "Joints are in the order of SMPL-X, NaN where unknown.",
    )


def check_mesh_is_close_to_the_joints(subject: BackendUnderTest) -> None:
    """The mesh vertices surround the joints: both are in metres and in the camera frame."""
    bodies = subject.result()
    if bodies.mesh is None or bodies.joints is None:
        return
    low, high = bodies.mesh.vertices.min(axis=1), bodies.mesh.vertices.max(axis=1)
    beyond = np.maximum(low[:, None] - bodies.joints, bodies.joints - high[:, None]).max(axis=2)
    worst = float(np.nanmax(beyond, initial=-np.inf))
    expect(
        worst < MAX_JOINT_TO_MESH_M,
        f"joints inside the mesh or at most {100 * MAX_JOINT_TO_MESH_M:.0f} cm outside of its bounding box",
        f"a joint {worst:.3g} m outside",
        "Are both in metres, and in the camera's frame?",
    )


def check_bodies_are_in_front(subject: BackendUnderTest) -> None:
    """The pelvis is in front of the camera: z is positive."""
    z = posed_bodies(subject.result())[1][:, 0, 2]
    expect(
        bool((z > 0).all()),
        "a pelvis in front of the camera, z > 0 (OpenCV: x right, y down, z forward)",
        f"z = {np.round(z, 2).tolist()} m",
        "Rotate bodies of an OpenGL camera by 180 degrees about x.",
    )


def check_bodies_are_in_metres(subject: BackendUnderTest) -> None:
    """The distance of the pelvis to the camera is within a factor of 3 of the true distance."""
    joints, truth = posed_bodies(subject.result())[1], subject.case("one person").truth
    own, true = (np.linalg.norm(j[:, 0], axis=1) for j in (joints, truth.joints))
    ratio = float(np.median(own / true))
    expect(
        1 / MAX_FACTOR < ratio < MAX_FACTOR,
        f"a distance to the camera in metres within a factor {MAX_FACTOR:g} of the true {float(true[0]):.2f} m",
        f"{float(own[0]):.4g}, {ratio:.3g} times the truth",
        "Is it centimetres or millimetres, or is another focal length used?",
    )


def check_bodies_project_into_the_boxes(subject: BackendUnderTest) -> None:
    """With the given intrinsics, most body joints project into the person's box."""
    case = subject.case("one person")
    pixels = _project(posed_bodies(subject.result())[1][:, :22], case.intrinsics)
    boxes = case.people.boxes
    grown = MARGIN * (boxes[:, 2:] - boxes[:, :2]).max(axis=1)[:, None, None]
    inside = (pixels > boxes[:, None, :2] - grown) & (pixels < boxes[:, None, 2:] + grown)
    share = float(inside.all(axis=2).mean())
    expect(
        share >= MIN_INSIDE,
        f"at least {MIN_INSIDE:.0%} of the joints projected into the person's box {np.round(boxes[0]).tolist()} px",
        f"{share:.0%}; the pelvis projects to {np.round(pixels[0, 0]).tolist()} px",
        "Is it in the frame of a crop, or of another camera than the given intrinsics?",
    )


def check_bodies_are_upright(subject: BackendUnderTest) -> None:
    """In the image, the pelvis-to-head direction is within 60 degrees of the true direction."""
    case = subject.case("one person")
    own, true = (
        _direction(_project(joints, case.intrinsics))
        for joints in (posed_bodies(subject.result())[1], case.truth.joints)
    )
    turn = float(np.degrees(np.arccos(np.clip((own * true).sum(axis=1), -1, 1))).max())
    expect(
        turn < MAX_TURN_DEG,
        f"a pelvis-to-head direction in the image within {MAX_TURN_DEG:.0f} degrees of the true one",
        f"{turn:.0f} degrees off",
        "y is down in the camera's frame." if turn > 150 else "",
    )


def check_left_is_the_bodys_left(subject: BackendUnderTest) -> None:
    """The left limbs of the body are on the person's left side."""
    from physic_core.body import JOINT_NAMES

    joints, true = (
        posed_bodies(subject.result())[1][:, :22],
        subject.case("one person").truth.joints[:, :22].astype(float),
    )
    other = mirrored_order(JOINT_NAMES[:22])
    sided = np.array(other) != np.arange(22)
    joints, true = joints - joints[:, :1], true - true[:, :1]
    right = float(np.linalg.norm(joints - true, axis=2)[:, sided].mean())
    swapped = float(np.linalg.norm(joints[:, other] - true, axis=2)[:, sided].mean())
    expect(
        swapped > 0.5 * right,
        "left limbs on the person's own left",
        f"{1000 * right:.0f} mm off as they are, {1000 * swapped:.0f} mm with left and right exchanged",
        "Are the sides exchanged, or does the body face away?",
    )


def _longest(rotvecs: FloatArray) -> float:
    """Return the length of the longest rotation vector, radians."""
    return float(np.linalg.norm(rotvecs.reshape(len(rotvecs), -1, 3), axis=2).max(initial=0))


def _project(points: FloatArray, camera: Intrinsics) -> FloatArray:
    """Project points (..., 3) in the camera frame to pixels (..., 2)."""
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    pixels: FloatArray = points[..., :2] / points[..., 2:] * focal + centre
    return pixels


def _direction(pixels: FloatArray) -> FloatArray:
    """Return the unit vectors (N, 2) from pelvis to head in the image."""
    from physic_core.body import JOINT_INDEX

    way = pixels[:, JOINT_INDEX["head"]] - pixels[:, JOINT_INDEX["pelvis"]]
    unit: FloatArray = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    return unit


_READ, _PARAMETERS = "physic_core.types.Bodies", "physic_core.types.BodyParameters"
_FORM = ("body_model_is_known", "angles_are_radians")
_PLACED = (
    *_FORM,
    "joints_suffice_to_convert_bodies",
    "mesh_is_close_to_the_joints",
    "bodies_are_in_front",
    "bodies_are_in_metres",
    "bodies_project_into_the_boxes",
)
CHECKS: tuple[Check, ...] = (
    *PEOPLE_CHECKS,
    *HINT_CHECKS,
    Check(check_body_model_is_known, _READ),
    Check(check_angles_are_radians, _PARAMETERS),
    Check(check_joints_suffice_to_convert_bodies, _READ, after=_FORM),
    Check(check_mesh_is_close_to_the_joints, _READ, after=_FORM),
    Check(check_bodies_are_in_front, _PARAMETERS, after=_PLACED[:4]),
    Check(check_bodies_are_in_metres, _PARAMETERS, after=_PLACED[:5]),
    Check(check_bodies_project_into_the_boxes, _PARAMETERS, after=_PLACED[:-1]),
    Check(check_bodies_are_upright, _PARAMETERS, after=_PLACED),
    Check(check_left_is_the_bodys_left, _PARAMETERS, after=(*_PLACED, "bodies_are_upright")),
    Check(check_rows_follow_the_people, _READ),
)
"""Checks of a BodyEstimator, in order of execution."""
