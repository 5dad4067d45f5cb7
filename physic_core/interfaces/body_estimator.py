"""Interface BodyEstimator: body model parameters of each person."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

from physic_core.interfaces.backend import Backend, Request
from physic_core.interfaces.checks import check_array, check_faces, check_limit, check_type, valid_rows, within
from physic_core.interfaces.limits import METRES, RADIANS, SHAPE
from physic_core.types import Bodies, BodyParameters, Hints, Mesh

if TYPE_CHECKING:
    from physic_core.types import BoolArray, Intrinsics, Keypoints, People, UInt8Array

_JOINTS = 55  # of SMPL-X
_ROTATIONS = 22  # of pelvis and body joints

_WIDTHS = {
    "global_orient": 3,
    "body_pose": 63,
    "left_hand_pose": 45,
    "right_hand_pose": 45,
    "jaw_pose": 3,
    "leye_pose": 3,
    "reye_pose": 3,
    "transl": 3,
}
"""Length of each parameter per person; betas and expression may have any length."""


@dataclass(frozen=True)
class BodyEstimatorRequest(Request[Bodies]):
    """Input of a BodyEstimator: the photo, its camera, N people, their keypoints and hints.

    The floor plane of the hints gives the vertical direction.
    """

    people: People
    intrinsics: Intrinsics
    keypoints: Keypoints
    hints: Hints = field(default_factory=Hints)


class BodyEstimator(Backend):
    """Estimates pose, shape and position of each person's body (paper: CameraHMR)."""

    interface = "body_estimator"
    api = 1
    Request = BodyEstimatorRequest
    Result = Bodies
    hints = ("intrinsics", "people", "keypoints", "scene", "original", "floor")

    @abstractmethod
    def infer(
        self, image: UInt8Array, people: People, intrinsics: Intrinsics, keypoints: Keypoints, hints: Hints
    ) -> Bodies:
        """Estimate one body for each of N people, in metres, camera frame.

        Bodies may be of any body model. Those of another than the configured one are converted to it from their
        ``joints``, and more accurately from their ``mesh``: give at least one of both unless the model is "embedded".

        At rest, bodies are y up, face +z and have their left on +x. ``global_orient`` rotates about the pelvis joint,
        then ``transl`` is added: to the origin of the body model, which is the pelvis joint of "embedded", but lies
        above the pelvis joint of "smpl" and "smplx".

        Example: ``global_orient`` (pi, 0, 0) and ``transl`` (0, 0, 3) of "embedded" are a person who stands 3 m ahead
        and faces the camera: pelvis (0, 0, 3), head at y = -0.6, ankles at y = 0.9, and the left wrist at x = 0.7, to
        the right in the image.
        """

    @classmethod
    def check(cls, result: Bodies, request: BodyEstimatorRequest) -> Iterator[str]:
        """Check the parameters, joints and mesh of N bodies; at least one body must be within limits."""
        n = len(request.people)
        wrong_type = [
            *check_type(result.parameters, BodyParameters, "parameters"),
            *check_type(result.body_model, str, "body_model"),
        ]
        if wrong_type:
            yield from wrong_type
            return
        yield from _check_parameters(result.parameters, n)
        if result.observed is not None:
            yield from check_array("observed", result.observed, (n, _JOINTS), "bool")
        if result.rotation_sigma is not None:
            yield from _check_rotation_sigma(result.rotation_sigma, n)
        if result.joints is not None:
            yield from _check_joints(result.joints, n)
        if result.mesh is not None:
            wrong_type = list(check_type(result.mesh, Mesh, "mesh"))
            yield from wrong_type or _check_mesh(result.mesh, n)


def valid_body_rows(bodies: Bodies) -> BoolArray:
    """Return (N,) bool: True for people whose parameters, joints and mesh vertices are within limits.

    ``joints`` may be NaN where the backend does not know them.
    """
    parameters, joints = bodies.parameters, bodies.joints
    arrays = [(getattr(parameters, field.name), _limit(field.name)[0]) for field in fields(parameters)]
    if bodies.mesh is not None:
        arrays.append((bodies.mesh.vertices, METRES))
    valid = valid_rows(arrays, len(parameters))
    if joints is not None:
        valid &= (within(joints, METRES) | (joints != joints)).all((1, 2))
    return valid


def _limit(name: str) -> tuple[float, str]:
    """Return the limit of a parameter, and its unit."""
    if name == "transl":
        return METRES, "m"
    return (SHAPE, "") if name in ("betas", "expression") else (RADIANS, "rad")


def _check_parameters(parameters: BodyParameters, people: int) -> Iterator[str]:
    readable = {}
    for name in (one.name for one in fields(parameters)):
        value = getattr(parameters, name)
        width = _WIDTHS.get(name, value.shape[-1] if getattr(value, "ndim", 0) else 0)
        wrong = list(check_array(name, value, (people, width), "float"))
        yield from wrong
        if not wrong:
            readable[name] = value
    if people and not valid_rows([(value, _limit(name)[0]) for name, value in readable.items()], people).any():
        for name, value in readable.items():
            yield from check_limit(name, value, *_limit(name))


def _check_rotation_sigma(sigma: Any, people: int) -> Iterator[str]:
    wrong = list(check_array("rotation_sigma", sigma, (people, _ROTATIONS), "float"))
    yield from wrong
    if not wrong and not ((sigma > 0) & (sigma <= math.pi) | (sigma != sigma)).all():
        yield "rotation_sigma must be within 0 and pi radians, or NaN where unknown"


def _check_joints(joints: Any, people: int) -> Iterator[str]:
    wrong = list(check_array("joints", joints, (people, _JOINTS, 3), "float"))
    yield from wrong
    if wrong or not people:
        return
    beyond = ~(within(joints, METRES) | (joints != joints))
    if beyond.any((1, 2)).all():
        yield f"joints must be within +-{METRES:g} m, or NaN where unknown, {int(beyond.sum())} are beyond"


def _check_mesh(mesh: Mesh, people: int) -> Iterator[str]:
    vertices = mesh.vertices.shape[1] if getattr(mesh.vertices, "ndim", 0) == 3 else 0
    wrong = [
        *check_type(mesh.name, str, "mesh.name"),
        *check_array("mesh.vertices", mesh.vertices, (people, vertices, 3), "float"),
    ]
    yield from wrong
    if not wrong and people and not valid_rows([(mesh.vertices, METRES)], people).any():
        yield from check_limit("mesh.vertices", mesh.vertices, METRES, "m")
    if mesh.rest is not None:
        wrong = list(check_array("mesh.rest", mesh.rest, (vertices, 3), "float"))
        yield from wrong or check_limit("mesh.rest", mesh.rest, METRES, "m")
    yield from check_faces("mesh.faces", mesh.faces, vertices)
