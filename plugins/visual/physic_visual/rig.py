"""Skeleton, skin and pose of one person, as animation formats need them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_core.backends.devices import limited_blas
from physic_core.body import JOINT_NAMES, PARENTS, ROTATION_FIELDS
from physic_core.errors import InputError, PhysicError
from physic_core.geometry import rotvec_to_rotmat_numpy, transform_points

if TYPE_CHECKING:
    from physic_core.body import BodyArrays
    from physic_core.export import ExportFrame, ExportRequest
    from physic_core.types import Float64Array, Int64Array, Person, Reconstruction


_SAME_BODY_M = 1e-3
"""Maximum distance of the posed vertices from those of the result, metres; a larger one is another
body file.
"""


_GIVE_FILE = "give the SMPL-X file that the result was made with (--body-model FILE)"


@dataclass(frozen=True)
class Rig:
    """Skinned mesh of one person: ``sum_k w_k G_k B_k v`` gives the posed vertices.

    Attributes:
        names: 55 joint names in SMPL-X order.
        parents: index of each joint's parent, -1 for the pelvis.
        vertices: (V, 3) metres, bind pose of the person's shape. Pose correctives of SMPL-X are
            included.
        faces: (F, 3).
        weights: (V, 55) skinning weights, rows sum to 1.
        inverse_bind: (55, 4, 4) B_j, from the bind pose to the joint.
        rotations: (55, 3, 3) of each joint relative to its parent, identity = T-pose; the pelvis in
            the frame.
        offsets: (55, 3) metres from the parent, in the parent's axes; the pelvis in the frame.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    vertices: Float64Array
    faces: Int64Array
    weights: Float64Array
    inverse_bind: Float64Array
    rotations: Float64Array
    offsets: Float64Array

    def joint_poses(self) -> Float64Array:
        """Return the pose (55, 4, 4) of each joint in the frame, G_j."""
        poses = np.tile(np.eye(4), (len(self.parents), 1, 1))
        for joint, parent in enumerate(self.parents):
            pose = np.eye(4)
            pose[:3, :3] = self.rotations[joint]
            pose[:3, 3] = self.offsets[joint]
            poses[joint] = pose if parent < 0 else poses[parent] @ pose
        return poses

    def posed_vertices(self) -> Float64Array:
        """Return the posed vertices (V, 3) in the frame, metres."""
        motions = (self.joint_poses() @ self.inverse_bind)[:, :3]
        blended = (self.weights @ motions.reshape(len(motions), -1)).reshape(-1, 3, 4)
        return (blended[..., :3] @ self.vertices[..., None])[..., 0] + blended[..., 3]


def bound_in_pose(rig: Rig, vertices: Float64Array) -> Rig:
    """Return a rig whose mesh is bound in the pose, so that readers without skinning show it there.

    Args:
        rig: of any bind pose.
        vertices: (V, 3) of its pose, in the frame.
    """
    return replace(
        rig, vertices=vertices, inverse_bind=np.linalg.inv(rig.joint_poses()).astype(np.float64)
    )


def body_of_result(result: Reconstruction, file: Path | None = None) -> BodyArrays:
    """Read the body model of a result's parameters.

    Args:
        result: of any body model.
        file: SMPL-X file; None for the one that the result's configuration names.

    Raises:
        InputError: the result has SMPL-X bodies and no file is known, or bodies of another model.
        BodyModelError: the file is not an SMPL-X model.
    """
    from physic_core.body import embedded_arrays, smplx_arrays

    if result.body_model == "embedded":
        if file is not None:
            raise InputError(
                "the bodies are those of the model that ships, and --body-model (body_model= in "
                "Python) is for SMPL-X: leave it out, or export to amass"
            )
        return embedded_arrays()
    if result.body_model != "smplx":
        raise InputError(
            f"the body model '{result.body_model}' has no known skeleton: use embedded or smplx"
        )
    named = (result.config.get("body_model") or {}).get("path") if file is None else file
    if not named or not Path(named).is_file():
        missing_file_text = (
            f"the file of the run, {named}, is not there"
            if named
            else "the result does not name it"
        )
        raise InputError(
            f"the bodies of this result need your SMPL-X file, but "
            f"{missing_file_text}: give its path (--body-model FILE, or body_model= in Python)"
        )
    parameters = result.people[0].parameters
    return smplx_arrays(
        named,
        num_betas=parameters.betas.shape[1],
        num_expression=parameters.expression.shape[1],
    )


def body_at_hand(result: Reconstruction) -> BodyArrays | None:
    """Return the body model of a result with people; None if it is not at hand, such as a file of
    another machine, or has another mesh.
    """
    try:
        model = body_of_result(result)
    except PhysicError:
        return None
    return model if np.array_equal(model.faces, result.faces) else None


def pose_rig(body: BodyArrays, person: Person, frame: ExportFrame) -> Rig:
    """Return skeleton, skin and pose of a person in a frame.

    Raises:
        InputError: the body model does not give the vertices of the person.
    """
    p = person.parameters
    shape = np.concatenate([p.betas[0], p.expression[0]]).astype(np.float64)
    _check_size(body, person, len(shape))
    turns = [getattr(p, name).reshape(count, 3) for name, count in ROTATION_FIELDS]
    local = rotvec_to_rotmat_numpy(np.concatenate(turns).astype(np.float64))
    rest = body.rest_joints(shape)
    vertices = _shaped_vertices(body, shape, local)
    bind = (
        np.tile(np.eye(3), (len(rest), 1, 1))
        if body.bind_rot is None
        else body.bind_rot.astype(np.float64)
    )
    inverse = np.tile(np.eye(4), (len(rest), 1, 1))
    inverse[:, :3, :3] = bind
    inverse[:, :3, 3] = -(bind @ rest[..., None])[..., 0]
    offsets = rest.copy()
    parents = np.array(PARENTS[1:])
    offsets[1:] = (bind[parents] @ (rest[1:] - rest[parents])[..., None])[..., 0]
    matrix = frame.from_camera
    local[0] = matrix[:3, :3] @ local[0]
    offsets[0] = matrix[:3, :3] @ (rest[0] + p.transl[0]) + matrix[:3, 3]
    weights = body.weights.astype(np.float64)
    rig = Rig(JOINT_NAMES, PARENTS, vertices, body.faces, weights, inverse, local, offsets)
    _check_pose(rig, person, frame)
    return rig


def _shaped_vertices(body: BodyArrays, shape: Float64Array, local: Float64Array) -> Float64Array:
    """Return the vertices (V, 3) of a shape in the bind pose, with the body's correctives of the
    pose.
    """
    coefficients = shape
    if len(body.directions) > len(shape):
        coefficients = np.concatenate([shape, (local[1:] - np.eye(3)).ravel()])
    vertices: Float64Array = body.template + np.tensordot(coefficients, body.directions, 1)
    return vertices


def _check_size(body: BodyArrays, person: Person, num_shape: int) -> None:
    for what, count, wanted in (
        ("vertices", len(body.template), len(person.vertices)),
        ("components of shape", len(body.joint_directions), num_shape),
    ):
        if count != wanted:
            raise InputError(
                f"the body model has {count} {what}, a body of the result {wanted}: {_GIVE_FILE}"
            )


def _check_pose(rig: Rig, person: Person, frame: ExportFrame) -> None:
    vertices = transform_points(frame.from_camera, person.vertices)
    apart = float(np.abs(rig.posed_vertices() - vertices).max())
    rounding = float(np.spacing(np.abs(person.vertices).max()))  # of a float32 far from the camera
    if not apart < _SAME_BODY_M + 2 * rounding:
        raise InputError(
            f"the body model gives vertices {1000 * apart:.0f} mm from those of the result: "
            f"{_GIVE_FILE}"
        )


def rigs(request: ExportRequest) -> list[tuple[int, Rig]]:
    """Return index and rig of the people of a request."""
    if not request.person:
        return []
    body = body_of_result(request.result, request.body_file)
    with limited_blas():
        return [
            (index, pose_rig(body, person, request.frame)) for index, person in request.chosen()
        ]
