"""Interfaces BodyEstimator, HandEstimator and ContactPrior: parameters, finger rotations and
contact of each person.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

from physic_core.interfaces.backend import Backend, Request
from physic_core.interfaces.checks import (
    METRES,
    RADIANS,
    SHAPE,
    check_faces,
    check_fields,
    check_limit,
    check_type,
    check_unit_range,
    rows_to_check,
    valid_rows,
    within_limit,
)
from physic_core.types import (
    Bodies,
    BodyParameters,
    ContactProbability,
    Hands,
    Hints,
    Mesh,
    RestMesh,
)

if TYPE_CHECKING:
    from physic_core.types import BoolArray, Intrinsics, Keypoints, People, UInt8Array


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
    hints = (
        *("intrinsics", "people", "keypoints", "observations"),
        *("scene", "original", "floor", "up"),
    )

    @abstractmethod
    def infer(
        self,
        image: UInt8Array,
        people: People,
        intrinsics: Intrinsics,
        keypoints: Keypoints,
        hints: Hints,
    ) -> Bodies:
        """Estimate one body for each of N people, in meters, camera frame.

        Bodies may be of any body model. Those of another than the configured one are converted to
        it from their ``joints``, and more accurately from their ``mesh``: give at least one of both
        unless the model is "embedded".

        At rest, bodies are y up, face +z and have their left on +x. ``global_orient`` rotates about
        the pelvis joint, then ``transl`` is added: to the origin of the body model, which is the
        pelvis joint of "embedded", but lies above the pelvis joint of "smpl" and "smplx".

        Example: ``global_orient`` (pi, 0, 0) and ``transl`` (0, 0, 3) of "embedded" are a person
        who stands 3 m ahead and faces the camera: pelvis (0, 0, 3), head at y = -0.6, ankles at y =
        0.9, and the left wrist at x = 0.7, to the right in the image.
        """

    @classmethod
    def check(cls, result: Bodies, request: BodyEstimatorRequest) -> Iterator[str]:
        """Check the parameters, joints and mesh of N bodies; at least one body must be within
        limits.
        """
        n = len(request.people)
        wrong_type = [
            *check_type(result.parameters, BodyParameters, "parameters"),
            *check_type(result.body_model, str, "body_model"),
        ]
        if wrong_type:
            yield from wrong_type
            return
        yield from _check_parameters(result.parameters, n)
        wrong = check_fields(result, N=n)
        yield from wrong
        if not wrong:
            yield from _check_sigma("rotation_sigma", result.rotation_sigma)
            yield from _check_sigma("joint_sigma", result.joint_sigma, METRES, "m")
            yield from _check_sigma("lean_sigma", result.lean_sigma)
            yield from _check_joints(result.joints)
        if result.mesh is not None:
            wrong_type = list(check_type(result.mesh, Mesh, "mesh"))
            yield from wrong_type or _check_mesh(result.mesh, n)


def valid_body_rows(bodies: Bodies) -> BoolArray:
    """Return (N,) bool: True for people whose parameters, joints and mesh vertices are within
    limits.

    ``joints`` may be NaN where the backend does not know them.
    """
    parameters = bodies.parameters
    joints = bodies.joints
    arrays = [
        (getattr(parameters, field.name), _limit(field.name)[0]) for field in fields(parameters)
    ]
    if bodies.mesh is not None:
        arrays.append((bodies.mesh.vertices, METRES))
    valid = valid_rows(arrays, len(parameters))
    if joints is not None:
        valid &= (within_limit(joints, METRES) | (joints != joints)).all((1, 2))
    return valid


def _limit(name: str) -> tuple[float, str]:
    """Return the limit of a parameter, and its unit."""
    if name == "transl":
        return METRES, "m"
    return (SHAPE, "") if name in ("betas", "expression") else (RADIANS, "rad")


def _check_parameters(parameters: BodyParameters, people: int) -> Iterator[str]:
    wrong = check_fields(parameters, N=people)
    yield from wrong
    if wrong or not people:
        return
    values = [(getattr(parameters, one.name), one.name) for one in fields(parameters)]
    if not valid_rows([(value, _limit(name)[0]) for value, name in values], people).any():
        for value, name in values:
            yield from check_limit(name, value, *_limit(name))


def _check_sigma(
    name: str, sigma: Any, largest: float = math.pi, unit: str = "radians"
) -> Iterator[str]:
    if sigma is not None and not ((sigma > 0) & (sigma <= largest) | (sigma != sigma)).all():
        limit = "pi" if largest == math.pi else f"{largest:g}"
        yield f"{name} must be within 0 and {limit} {unit}, or NaN where unknown"


def _check_joints(joints: Any) -> Iterator[str]:
    if joints is None or not len(joints):
        return
    beyond = ~(within_limit(joints, METRES) | (joints != joints))
    if beyond.any((1, 2)).all():
        yield (
            f"joints must be within +-{METRES:g} m, or NaN where unknown, {int(beyond.sum())} "
            f"are beyond"
        )


def _check_mesh(mesh: Mesh, people: int) -> Iterator[str]:
    wrong = [*check_type(mesh.name, str, "mesh.name"), *check_fields(mesh, "mesh.", N=people)]
    yield from wrong
    if wrong:
        return
    if people and not valid_rows([(mesh.vertices, METRES)], people).any():
        yield from check_limit("mesh.vertices", mesh.vertices, METRES, "m")
    if mesh.rest is not None:
        yield from check_limit("mesh.rest", mesh.rest, METRES, "m")
    yield from check_faces("mesh.faces", mesh.faces, mesh.vertices.shape[1])


@dataclass(frozen=True)
class HandEstimatorRequest(Request[Hands]):
    """Input of a HandEstimator: the photo, N people and their keypoints."""

    people: People
    keypoints: Keypoints


class HandEstimator(Backend):
    """Estimates the finger rotations of both hands of each person (paper: WiLoR)."""

    interface = "hand_estimator"
    api = 1
    Request = HandEstimatorRequest
    Result = Hands

    @abstractmethod
    def infer(self, image: UInt8Array, people: People, keypoints: Keypoints) -> Hands:
        """Estimate 15 joint rotations and a confidence for each hand; 0 for a hand that is not
        visible.

        With ``wrists``, the global rotation of each hand, forearms are rotated to fit, weighted by
        confidence. Fingers of every confidence above 0 are used: return 0 for what is likely wrong.

        Example: a network for right hands got the mirrored crop of a left hand. Each of its
        rotation vectors (x, y, z) becomes (x, -y, -z), and hand 0. MANO's hands with
        flat_hand_mean=False need the mean pose added.
        """

    @classmethod
    def check(cls, result: Hands, request: HandEstimatorRequest) -> Iterator[str]:
        """Check N x 2 hands; rotations with a confidence above 0 must be within limits."""
        wrong = check_fields(result, N=len(request.people))
        yield from wrong
        if wrong:
            return
        rows = rows_to_check(valid_hand_rows(result))
        confidence = result.confidence[rows]
        yield from check_unit_range("confidence", confidence)
        yield from check_limit("rotvecs", result.rotvecs[rows][confidence > 0], RADIANS, "rad")
        if result.wrists is not None:
            yield from check_limit("wrists", result.wrists[rows][confidence > 0], RADIANS, "rad")


def valid_hand_rows(hands: Hands) -> BoolArray:
    """Return (N,) bool: True for people with finite confidence, and rotations of all detected hands
    within limits.
    """
    undetected = hands.confidence <= 0
    valid = valid_rows([(hands.confidence, math.inf)], len(hands.confidence))
    valid &= (within_limit(hands.rotvecs, RADIANS).all((-2, -1)) | undetected).all(1)
    if hands.wrists is not None:
        valid &= (within_limit(hands.wrists, RADIANS).all(-1) | undetected).all(1)
    return valid


@dataclass(frozen=True)
class ContactPriorRequest(Request[ContactProbability]):
    """Input of a ContactPrior: the photo, N people and their bodies.

    Attributes:
        people: N people.
        bodies: of the configured body model, with ``joints`` if that is a file of the user's.
        topology: mesh of ``bodies``, or None to accept any mesh. Not passed to ``infer``.
        vertices: number of vertices of ``topology``. Not passed to ``infer``.
    """

    people: People
    bodies: Bodies
    topology: str | None = field(default=None, kw_only=True)
    vertices: int | None = field(default=None, kw_only=True)


class ContactPrior(Backend):
    """Predicts the contact probability of each body vertex (paper: DECO)."""

    interface = "contact_prior"
    api = 1
    Request = ContactPriorRequest
    Result = ContactProbability

    @abstractmethod
    def infer(self, image: UInt8Array, people: People, bodies: Bodies) -> ContactProbability:
        """Predict the contact probability of each vertex of N bodies.

        The probabilities may be on any mesh. If it is not the mesh of the bodies, give that mesh in
        the T-pose as ``rest``: the core transfers the probabilities. Vertices of 0.5 and more count
        as in contact.

        Example: people who stand have about 0.9 at the vertices of their soles, and about 0
        elsewhere.
        """

    @classmethod
    def check(cls, result: ContactProbability, request: ContactPriorRequest) -> Iterator[str]:
        """Check contact probabilities of N people: in [0, 1], one per vertex of the bodies or of
        ``result.rest``.
        """
        topology = request.topology
        sizes = {}
        if topology is not None and request.vertices is not None:
            sizes["V"] = request.vertices
            if result.topology != topology:
                if result.rest is None:
                    yield f"topology must be {topology!r} as the bodies', got {result.topology!r}"
                    return
                wrong = list(_check_rest(result.rest, result.topology))
                if wrong:
                    yield from wrong
                    return
                sizes["V"] = len(result.rest.vertices)
        wrong = check_fields(result, "", N=len(request.people), **sizes)
        yield from wrong or check_unit_range(
            "probability", result.probability[rows_to_check(valid_contact_rows(result))]
        )


def valid_contact_rows(contact: ContactProbability) -> BoolArray:
    """Return (N,) bool: True for people with finite probabilities."""
    return valid_rows([(contact.probability, math.inf)], len(contact.probability))


def _check_rest(rest: RestMesh, topology: str) -> Iterator[str]:
    wrong_type = list(check_type(rest, RestMesh, "rest"))
    if wrong_type:
        yield from wrong_type
        return
    if rest.topology != topology:
        yield f"rest must be the mesh {topology!r} of the probabilities, got {rest.topology!r}"
    wrong = check_fields(rest, "rest.")
    yield from wrong
    if not wrong:
        yield from check_limit("rest.vertices", rest.vertices, METRES, "m")
        yield from check_faces("rest.faces", rest.faces, len(rest.vertices))
