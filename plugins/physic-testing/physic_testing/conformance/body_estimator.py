"""Checks of a BodyEstimator: parameters of a known body, in radians and metres, where the photo shows the person."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.answering import CHECKS_OF_HINTS, CHECKS_OF_PEOPLE
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import expect
from physic_testing.conformance.rows import check_rows_follow_the_people
from physic_testing.conformance.truth import embedded_body, mirrored_order, model_of, posed_bodies

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Intrinsics
    from physic_testing.conformance.subject import Subject

__all__ = ["CHECKS"]

FACTOR = 3.0
LEAST_INSIDE, MARGIN = 0.6, 0.25
MOST_TURN_DEG = 60.0
BESIDE_M = 0.1
_KNOWN = ("embedded", "smplx")
_ROTATIONS = ("global_orient", "body_pose", "left_hand_pose", "right_hand_pose", "jaw_pose", "leye_pose", "reye_pose")


def check_body_model_is_known(subject: Subject) -> None:
    """`body_model` names a known body, and shape and expression have its sizes; or joints or a mesh are given."""
    from physic_core.body.conversion import can_carry

    bodies = subject.answer()
    told = can_carry(bodies, embedded_body())
    expect(
        told or bodies.body_model in _KNOWN,
        f"the name of a body model, {', '.join(_KNOWN)}, or joints of SMPL-X, or a mesh with its T-pose",
        f"{bodies.body_model!r} alone",
    )
    if told and bodies.body_model != "embedded":
        return
    model, parameters = model_of(bodies), bodies.parameters
    for name, wanted in (("betas", model.num_betas), ("expression", model.num_expression)):
        count = getattr(parameters, name).shape[1]
        expect(count == wanted, f"{name} of {wanted} components for the body {bodies.body_model!r}", f"{count}")


def check_angles_are_radians(subject: Subject) -> None:
    """Rotation vectors are in radians: none is longer than a full turn."""
    parameters = subject.answer().parameters
    for name in _ROTATIONS:
        longest = _longest(getattr(parameters, name))
        expect(longest < 2 * np.pi + 0.01, f"rotation vectors in radians, up to 6.28, in {name}", f"{longest:.1f}")


def check_joints_suffice_to_convert_bodies(subject: Subject) -> None:
    """Joints of a body of another model include hips, and shoulders or neck, so that it can be converted."""
    from physic_core.body.conversion import to_model

    bodies = subject.answer()
    carried = to_model(bodies, model_of(bodies)).parameters.transl
    lost = np.isnan(carried[:, 0]) & np.isfinite(bodies.parameters.transl[:, 0])
    expect(
        not lost.any(),
        "known joints of both hips, and of both shoulders or the neck",
        f"{int(lost.sum())} of {len(carried)} bodies without",
        "Joints are in the order of SMPL-X, NaN where unknown.",
    )


def check_surface_is_where_the_joints_are(subject: Subject) -> None:
    """A surface that comes with joints lies round them, in the same frame and unit."""
    bodies = subject.answer()
    if bodies.mesh is None or bodies.joints is None:
        return
    low, high = bodies.mesh.vertices.min(axis=1), bodies.mesh.vertices.max(axis=1)
    beyond = np.maximum(low[:, None] - bodies.joints, bodies.joints - high[:, None]).max(axis=2)
    worst = float(np.nanmax(beyond, initial=-np.inf))
    expect(
        worst < BESIDE_M,
        f"joints within the surface, or {100 * BESIDE_M:.0f} cm beside it at most",
        f"a joint {worst:.3g} m outside of all vertices",
        "Are both in metres, and in the camera's frame?",
    )


def check_bodies_are_in_front(subject: Subject) -> None:
    """People are in front of the camera: z is forward."""
    z = posed_bodies(subject.answer())[1][:, 0, 2]
    expect(
        bool((z > 0).all()),
        "a pelvis in front of the camera, z > 0 (OpenCV: x right, y down, z forward)",
        f"z = {np.round(z, 2).tolist()} m",
        "Turn bodies of an OpenGL camera by half a turn about x.",
    )


def check_bodies_are_in_metres(subject: Subject) -> None:
    """People are about as far away as they truly are."""
    joints, truth = posed_bodies(subject.answer())[1], subject.case("one person").truth
    own, true = (np.linalg.norm(j[:, 0], axis=1) for j in (joints, truth.joints))
    ratio = float(np.median(own / true))
    expect(
        1 / FACTOR < ratio < FACTOR,
        f"metres from the camera: within a factor {FACTOR:g} of the true {float(true[0]):.2f} m",
        f"{float(own[0]):.4g}, {ratio:.3g} times the truth",
        "Is it centimetres or millimetres, or a focal length of its own?",
    )


def check_bodies_are_seen_at_their_people(subject: Subject) -> None:
    """Projected with the given camera, most joints fall into the person's box."""
    case = subject.case("one person")
    pixels = _project(posed_bodies(subject.answer())[1][:, :22], case.intrinsics)
    boxes = case.people.boxes
    grown = MARGIN * (boxes[:, 2:] - boxes[:, :2]).max(axis=1)[:, None, None]
    inside = (pixels > boxes[:, None, :2] - grown) & (pixels < boxes[:, None, 2:] + grown)
    share = float(inside.all(axis=2).mean())
    expect(
        share >= LEAST_INSIDE,
        f"at least {LEAST_INSIDE:.0%} of the joints seen in the person's box {np.round(boxes[0]).tolist()} px",
        f"{share:.0%}; the pelvis is seen at {np.round(pixels[0, 0]).tolist()} px",
        "Is it in the frame of a crop, or of another camera than the given one?",
    )


def check_bodies_are_upright(subject: Subject) -> None:
    """The way from pelvis to head points in the photo where the person's does."""
    case = subject.case("one person")
    own, true = (
        _direction(_project(joints, case.intrinsics))
        for joints in (posed_bodies(subject.answer())[1], case.truth.joints)
    )
    turn = float(np.degrees(np.arccos(np.clip((own * true).sum(axis=1), -1, 1))).max())
    expect(
        turn < MOST_TURN_DEG,
        f"a body that points in the photo as the person does, within {MOST_TURN_DEG:.0f} degrees",
        f"{turn:.0f} degrees off",
        "y is down in the camera's frame." if turn > 150 else "",
    )


def check_left_is_the_bodys_left(subject: Subject) -> None:
    """The body faces where the person faces: left limbs are on the person's left."""
    from physic_core.body import JOINT_NAMES

    joints, true = (
        posed_bodies(subject.answer())[1][:, :22],
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
    return float(np.linalg.norm(rotvecs.reshape(len(rotvecs), -1, 3), axis=2).max(initial=0))


def _project(points: FloatArray, camera: Intrinsics) -> FloatArray:
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    pixels: FloatArray = points[..., :2] / points[..., 2:] * focal + centre
    return pixels


def _direction(pixels: FloatArray) -> FloatArray:
    from physic_core.body import JOINT_INDEX

    way = pixels[:, JOINT_INDEX["head"]] - pixels[:, JOINT_INDEX["pelvis"]]
    unit: FloatArray = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    return unit


_READ, _PARAMETERS = "physic_core.types.Bodies", "physic_core.types.BodyParameters"
_FORM = ("body_model_is_known", "angles_are_radians")
_PLACED = (
    *_FORM,
    "joints_suffice_to_convert_bodies",
    "surface_is_where_the_joints_are",
    "bodies_are_in_front",
    "bodies_are_in_metres",
    "bodies_are_seen_at_their_people",
)
CHECKS: tuple[Check, ...] = (
    *CHECKS_OF_PEOPLE,
    *CHECKS_OF_HINTS,
    Check(check_body_model_is_known, _READ),
    Check(check_angles_are_radians, _PARAMETERS),
    Check(check_joints_suffice_to_convert_bodies, _READ, after=_FORM),
    Check(check_surface_is_where_the_joints_are, _READ, after=_FORM),
    Check(check_bodies_are_in_front, _PARAMETERS, after=_PLACED[:4]),
    Check(check_bodies_are_in_metres, _PARAMETERS, after=_PLACED[:5]),
    Check(check_bodies_are_seen_at_their_people, _PARAMETERS, after=_PLACED[:-1]),
    Check(check_bodies_are_upright, _PARAMETERS, after=_PLACED),
    Check(check_left_is_the_bodys_left, _PARAMETERS, after=(*_PLACED, "bodies_are_upright")),
    Check(check_rows_follow_the_people, _READ),
)
"""In the order in which they make sense."""
