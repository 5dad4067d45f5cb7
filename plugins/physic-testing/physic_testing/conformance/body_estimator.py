"""Checks of a BodyEstimator: body model, units, camera frame, position, orientation and left-right order."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import JOINT_NAMES
from physic_testing.conformance.bias import (
    expect_follows,
    expect_no_better,
    expect_no_bias,
    expect_order,
    mean_and_margin,
    spread,
)
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.output_checks import HINT_CHECKS, PEOPLE_CHECKS
from physic_testing.conformance.row_order import check_rows_follow_the_people
from physic_testing.conformance.truth import (
    embedded_body,
    embedded_surface,
    mirrored_order,
    model_of,
    parameters_of_model,
    rotation_errors_deg,
)

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Intrinsics
    from physic_testing.conformance.backend_under_test import BackendUnderTest

MAX_FACTOR = 3.0
MIN_INSIDE, MARGIN = 0.6, 0.25
MAX_ACROSS_M, MAX_DISTANCE, MAX_TURN_DEG = 0.05, 1.2, 6.0
"""Mean error across the line of sight, factor on the distance and mean rotation that are treated as zero."""

MUCH_CLEARER = 0.6
"""As of ``expect_no_better``: another order leaves a quarter of the wrong joints."""

_CROP = (
    "Is it the focal length of the crop, or of the network? z is the focal length of the photo in px / px per metre, "
    "in px of the photo: scale what the network says of a crop by the side of the crop."
)

MAX_JOINT_TO_MESH_M = 0.1
_KNOWN = ("embedded", "smplx")
_BODY = 22
"""Number of joints without face and fingers."""

_ROTATIONS = ("global_orient", "body_pose", "left_hand_pose", "right_hand_pose", "jaw_pose", "leye_pose", "reye_pose")


def check_body_model_is_known(subject: BackendUnderTest) -> None:
    """`body_model` is known, with matching betas and expression, or the bodies have joints or a mesh."""
    from physic_core.body.convert.bodies import can_convert

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
    bodies = subject.result()
    carried = parameters_of_model(bodies).transl
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
    z = embedded_surface(subject.result())[1][:, 0, 2]
    expect(
        bool((z > 0).all()),
        "a pelvis in front of the camera, z > 0 (OpenCV: x right, y down, z forward)",
        f"z = {np.round(z, 2).tolist()} m",
        "Rotate bodies of an OpenGL camera by 180 degrees about x.",
    )


def check_bodies_are_in_metres(subject: BackendUnderTest) -> None:
    """The distance of the pelvis to the camera is within a factor of 3 of the true distance."""
    joints, truth = embedded_surface(subject.result())[1], subject.case("one person").truth
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
    pixels = _project(embedded_surface(subject.result())[1][:, :22], case.intrinsics)
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


def check_bodies_are_in_place(subject: BackendUnderTest) -> None:
    """Bodies have no common error of place: 5 cm across the line of sight, a fifth of the distance."""
    for axis, way in enumerate(("right", "down")):
        expect_no_bias(
            np.array([np.mean([p.across[axis] for p in photo]) for photo in _people(subject)]),
            MAX_ACROSS_M,
            "bodies where people are in the photo",
            f" m {way}",
            "transl is added after posing; it is the place of the pelvis only where that is the origin at rest.",
        )
    expect_no_bias(
        np.array([np.mean([100 * p.log_distance for p in photo]) for photo in _people(subject)]),
        100 * float(np.log(MAX_DISTANCE)),
        "bodies as far away as people in the photo",
        " % (of the logarithm) farther",
        "Is the distance that of the network's own focal length? Rescale it to the given intrinsics.",
    )


def check_distance_does_not_depend_on_the_crop(subject: BackendUnderTest) -> None:
    """The error of the distance does not grow with the size of a person's box, or with the focal length."""
    people = [p for photo in _people(subject) for p in photo]
    logs, sides, focals = (np.array([getattr(p, n) for p in people]) for n in ("log_distance", "log_side", "log_focal"))
    readings = {
        "multiplied by the side of the person's box": logs + sides,
        "divided by the side of the person's box": logs - sides,
        "multiplied by the focal length": logs + focals,
        "divided by the focal length": logs - focals,
    }
    expect_no_better(
        spread(logs),
        {words: spread(errors) for words, errors in readings.items()},
        0.01,
        "distances in one ratio to the true ones, deviation of log(distance / true distance) from its mean",
        dict.fromkeys(readings, _CROP),
    )


def check_pose_is_not_turned_or_mirrored(subject: BackendUnderTest) -> None:
    """Bodies are upright as in the photo, face the same way, and have their left limbs on their left side."""
    people = [p for photo in _people(subject) for p in photo]
    joints, true = (np.stack([getattr(p, name) for p in people]) for name in ("joints", "true_joints"))
    other, vertical = mirrored_order(JOINT_NAMES[:_BODY]), np.stack([p.vertical for p in people])[:, None]
    readings = {
        "mirrored": joints[:, other] * [-1, 1, 1],
        "with left and right limbs exchanged": joints[:, other],
        "turned upside down": joints * [1, -1, -1],
        "facing the other way": 2 * (joints * vertical).sum(2, keepdims=True) * vertical - joints,
    }
    expect_no_better(
        np.linalg.norm(joints - true, axis=2).mean(1),
        {words: np.linalg.norm(found - true, axis=2).mean(1) for words, found in readings.items()},
        0.001,
        "bodies upright, facing and with their sides as in the photo, mean error of the joints in m",
        {
            "mirrored": "Was the photo mirrored for the network, and the body not mirrored back?",
            "turned upside down": "y is down in the camera's frame.",
        },
    )


def check_bodies_face_the_right_way(subject: BackendUnderTest) -> None:
    """The orientation of bodies has no common error above 6 degrees."""
    turns = np.array([p.turn_deg for photo in _people(subject) for p in photo])
    for axis, name in enumerate("xyz"):
        expect_no_bias(
            turns[:, axis],
            MAX_TURN_DEG,
            f"bodies without a common rotation about the {name} axis of the camera",
            " degrees",
            "A crop beside the image's centre is seen by a rotated camera: rotate bodies back.",
        )


def check_joints_are_in_order(subject: BackendUnderTest) -> None:
    """Neither the places nor the rotations of the joints are exchanged, nor are the rotations inverse."""
    people = [p for photo in _people(subject) for p in photo]
    expected, hint = "joints in the order of SMPL-X, mean error in {}", "Is it the order of another body model?"
    places = np.stack([np.linalg.norm(p.joints[:, None] - p.true_joints, axis=2) for p in people])
    expect_order(places, JOINT_NAMES[:_BODY], 0.001, expected.format("m"), hint)
    pose, true = (np.stack([getattr(p, name) for p in people]) for name in ("pose", "true_pose"))
    apart = rotation_errors_deg(*np.broadcast_arrays(pose[:, :, None], true[:, None]))
    expect_order(apart, JOINT_NAMES[1:_BODY], 0.1, expected.format("degrees"), hint)
    expect_no_better(
        rotation_errors_deg(pose, true).mean(1),
        {"inverse": rotation_errors_deg(-pose, true).mean(1)},
        0.1,
        "rotations of joints relative to their parents, mean error in degrees",
        {"inverse": "Is the matrix transposed?"},
    )


def check_observed_is_true_in_sight(subject: BackendUnderTest) -> None:
    """`observed`, if given, is more often True for joints in sight than for hidden ones."""
    more, wrong, mirrored = [], [], []
    for case, bodies in subject.evidence():
        if bodies.observed is None:
            raise CheckSkipped("it returns no `observed`")
        for own, seen in zip(bodies.observed[:, :_BODY], case.truth.joints_visible[:, :_BODY], strict=True):
            wrong.append(float((own != seen).mean()))
            mirrored.append(float((own[mirrored_order(JOINT_NAMES[:_BODY])] != seen).mean()))
            if 0 < seen.sum() < len(seen):
                more.append(own[seen].mean() - own[~seen].mean())
    mean, margin = mean_and_margin(np.array(more))
    expect(
        mean + margin > 0 and bool(np.any(more)),
        "True for joints in sight, and False for hidden ones",
        f"{mean:+.0%} more True values in sight, with three standard errors of {margin:.0%}",
        "Is it inverted, or True for all joints? Return None if the network does not tell.",
    )
    expect_no_better(
        np.array(wrong),
        {"of the other side": np.array(mirrored)},
        0.01,
        "True for joints in sight, share of joints",
        {"of the other side": "Was the output for a mirrored photo mirrored back?"},
        clearly=MUCH_CLEARER,
    )


def check_pose_follows_the_photo(subject: BackendUnderTest) -> None:
    """The pose is that of the photo: not the same T-pose in all photos."""
    people = [p for photo in _people(subject) for p in photo]
    expect_follows([p.pose for p in people], [p.true_pose for p in people], "body_pose")


@dataclass(frozen=True)
class _Person:
    """Estimated and true body: joints about the pelvis (22, 3) m, pose (21, 3), errors and the upward axis.

    ``log_side`` is the logarithm of the larger side of the box, ``log_focal`` that of the focal length, both in px.
    """

    joints: FloatArray
    true_joints: FloatArray
    pose: FloatArray
    true_pose: FloatArray
    across: FloatArray
    log_distance: float
    log_side: float
    log_focal: float
    turn_deg: FloatArray
    vertical: FloatArray


@lru_cache(maxsize=1)
def _people(subject: BackendUnderTest) -> list[list[_Person]]:
    """Return the people of each photo."""
    from scipy.spatial.transform import Rotation

    photos = []
    for case, bodies in subject.evidence():
        given, truth = parameters_of_model(bodies), case.truth
        joints, true = embedded_surface(bodies)[1][:, :_BODY], truth.joints[:, :_BODY].astype(np.float64)
        at, place = joints[:, 0], true[:, 0]
        across = (at[:, :2] / at[:, 2:] - place[:, :2] / place[:, 2:]) * place[:, 2:]
        distance = np.log(np.linalg.norm(at, axis=1) / np.linalg.norm(place, axis=1))
        root, true_root = (Rotation.from_rotvec(p.global_orient) for p in (given, truth.parameters))
        turn = np.degrees((root * true_root.inv()).as_rotvec())
        vertical = root.apply([0, 1, 0]).reshape(-1, 3)
        side = np.log((case.people.boxes[:, 2:] - case.people.boxes[:, :2]).max(axis=1))
        focal = np.full(len(side), np.log(case.intrinsics.fx))
        pose, true_pose = (p.body_pose.reshape(len(p), -1, 3) for p in (given, truth.parameters))
        rows = (
            joints - at[:, None],
            true - place[:, None],
            pose,
            true_pose,
            across,
            distance,
            side,
            focal,
            turn,
            vertical,
        )
        kept = np.flatnonzero(np.isfinite(at).all(axis=1))
        photos.append([_Person(*(values[i] for values in rows)) for i in kept])
    return [photo for photo in photos if photo]


def _longest(rotvecs: FloatArray) -> float:
    """Return the length of the longest rotation vector, radians."""
    return float(np.linalg.norm(rotvecs.reshape(len(rotvecs), -1, 3), axis=2).max(initial=0))


def _project(points: FloatArray, camera: Intrinsics) -> FloatArray:
    """Project points (..., 3) in the camera frame to pixels (..., 2)."""
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    pixels: FloatArray = points[..., :2] / points[..., 2:] * focal + centre
    return pixels


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
_UPRIGHT = (*_PLACED, "pose_is_not_turned_or_mirrored")
_ORDERED = (*_UPRIGHT, "joints_are_in_order")
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
    Check(check_bodies_are_in_place, _PARAMETERS, after=_PLACED, unless=BLIND),
    Check(check_distance_does_not_depend_on_the_crop, _PARAMETERS, after=_PLACED, unless=BLIND),
    Check(check_pose_is_not_turned_or_mirrored, _PARAMETERS, after=_PLACED, unless=BLIND),
    Check(check_joints_are_in_order, _PARAMETERS, after=_UPRIGHT, unless=BLIND),
    Check(check_pose_follows_the_photo, _PARAMETERS, after=_ORDERED, unless=BLIND),
    Check(check_bodies_face_the_right_way, _PARAMETERS, after=_ORDERED, unless=BLIND),
    Check(check_observed_is_true_in_sight, _READ, unless=BLIND),
    Check(check_rows_follow_the_people, _READ),
)
"""Checks of a BodyEstimator, in order of execution."""
