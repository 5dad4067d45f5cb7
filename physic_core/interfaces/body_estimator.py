"""Interface BodyEstimator: body model parameters of each person."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from physic_core.interfaces.backend import Backend, Request
from physic_core.interfaces.checks import check_array, check_faces, check_finite, check_type, finite_rows
from physic_core.types import Bodies, BodyParameters, Mesh

if TYPE_CHECKING:
    from physic_core.types import BoolArray, Hints, Intrinsics, Keypoints, People, UInt8Array

__all__ = ["BodyEstimator", "BodyEstimatorRequest", "finite_bodies"]

_JOINTS = 55  # of SMPL-X

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
    hints: Hints


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
        """

    @classmethod
    def check(cls, result: Bodies, request: BodyEstimatorRequest) -> Iterator[str]:
        """Check the parameters, joints and mesh of N bodies; at least one body must be finite."""
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
        if result.joints is not None:
            yield from _check_joints(result.joints, n)
        if result.mesh is not None:
            wrong_type = list(check_type(result.mesh, Mesh, "mesh"))
            yield from wrong_type or _check_mesh(result.mesh, n)


def finite_bodies(bodies: Bodies) -> BoolArray:
    """Return (N,) bool: True for people with finite parameters and finite mesh vertices.

    ``joints`` may be NaN where the backend does not know them.
    """
    parameters = bodies.parameters
    arrays = [getattr(parameters, field.name) for field in fields(parameters)]
    return finite_rows(arrays if bodies.mesh is None else [*arrays, bodies.mesh.vertices], len(parameters))


def _check_parameters(parameters: BodyParameters, people: int) -> Iterator[str]:
    readable = {}
    for field in fields(parameters):
        value = getattr(parameters, field.name)
        width = _WIDTHS.get(field.name, value.shape[-1] if getattr(value, "ndim", 0) else 0)
        wrong = list(check_array(field.name, value, (people, width), "float"))
        yield from wrong
        if not wrong:
            readable[field.name] = value
    if people and not finite_rows(readable.values(), people).any():
        for name, value in readable.items():
            yield from check_finite(name, value)


def _check_joints(joints: Any, people: int) -> Iterator[str]:
    wrong = list(check_array("joints", joints, (people, _JOINTS, 3), "float"))
    yield from wrong
    if not wrong and (count := int((abs(joints) == math.inf).sum())):
        yield f"joints must be metres, or NaN where unknown, {count} are infinite"


def _check_mesh(mesh: Mesh, people: int) -> Iterator[str]:
    vertices = mesh.vertices.shape[1] if getattr(mesh.vertices, "ndim", 0) == 3 else 0
    wrong = [
        *check_type(mesh.name, str, "mesh.name"),
        *check_array("mesh.vertices", mesh.vertices, (people, vertices, 3), "float"),
    ]
    yield from wrong
    if not wrong and people and not finite_rows([mesh.vertices], people).any():
        yield from check_finite("mesh.vertices", mesh.vertices)
    if mesh.rest is not None:
        wrong = list(check_array("mesh.rest", mesh.rest, (vertices, 3), "float"))
        yield from wrong or check_finite("mesh.rest", mesh.rest)
    yield from check_faces("mesh.faces", mesh.faces, vertices)
