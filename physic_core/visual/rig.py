"""Skeleton, skin and pose of one person, as animation formats need them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_core.adapters.devices import limited_threads
from physic_core.body import load_body
from physic_core.body.bones import rotations_from_parameters
from physic_core.body.joints import JOINT_NAMES, PARENTS
from physic_core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import Person, Reconstruction
    from physic_core.visual.export.request import ExportFrame, ExportRequest

    Array = NDArray[np.float64]

_SAME_BODY_M = 1e-3
"""Maximum distance of the posed vertices from those of the result, metres; a larger one is another
body file.
"""


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
    vertices: Array
    faces: NDArray[np.int64]
    weights: Array
    inverse_bind: Array
    rotations: Array
    offsets: Array

    def world(self) -> Array:
        """Return the pose (55, 4, 4) of each joint in the frame, G_j."""
        poses = np.tile(np.eye(4), (len(self.parents), 1, 1))
        for joint, parent in enumerate(self.parents):
            own = np.eye(4)
            own[:3, :3] = self.rotations[joint]
            own[:3, 3] = self.offsets[joint]
            poses[joint] = own if parent < 0 else poses[parent] @ own
        return poses


def bound_in_pose(rig: Rig, vertices: Array) -> Rig:
    """Return a rig whose mesh is bound in the pose, so that readers without skinning show it there.

    Args:
        rig: of any bind pose.
        vertices: (V, 3) of its pose, in the frame.
    """
    return replace(
        rig, vertices=vertices, inverse_bind=np.linalg.inv(rig.world()).astype(np.float64)
    )


def body_of_result(result: Reconstruction, file: Path | None = None) -> BodyModel:
    """Load the body model of a result's parameters, float64.

    Args:
        result: of any body model.
        file: SMPL-X file; None for the one that the result's configuration names.

    Raises:
        InputError: the result has SMPL-X bodies and no file is known, or bodies of another model.
        BodyModelError: the file is not an SMPL-X model.
    """
    if result.body_model == "embedded":
        return load_body("embedded").to(dtype=torch.float64)
    if result.body_model != "smplx":
        raise InputError(f"no skeleton is known for bodies of the model '{result.body_model}'")
    named = (result.config.get("body_model") or {}).get("path") if file is None else file
    if not named or not Path(named).is_file():
        lost = (
            f"the file of the run, {named}, is not there"
            if named
            else "the result does not name it"
        )
        raise InputError(
            f"the result has SMPL-X bodies, whose skeleton is in your SMPL-X file, and {lost}: "
            f"give its path "
            "(--body-model FILE, or body_model= in Python)"
        )
    from physic_core.body.files import load_smplx

    parameters = result.people[0].parameters
    sizes = {
        "num_betas": parameters.betas.shape[1],
        "num_expression": parameters.expression.shape[1],
    }
    return load_smplx(named, **sizes).to(dtype=torch.float64)


def pose_rig(model: BodyModel, person: Person, frame: ExportFrame) -> Rig:
    """Return skeleton, skin and pose of a person in a frame.

    Raises:
        InputError: the model does not give the vertices of the person.
    """
    p = person.parameters
    rotations = rotations_from_parameters(p, dtype=torch.float64)
    betas, expression = (torch.from_numpy(np.array(v, np.float64)) for v in (p.betas, p.expression))
    transl = torch.from_numpy(np.array(p.transl, np.float64))
    shape = torch.cat([betas, expression], 1) if model.num_expression else betas
    posed = model(rotations, betas, transl, expression if model.num_expression else None)
    made = posed.vertices[0].numpy()
    give_file = "give the SMPL-X file that the result was made with (--body-model FILE)"
    if made.shape != person.vertices.shape:
        raise InputError(
            f"the body model has {len(made)} vertices, a body of the result "
            f"{len(person.vertices)}: {give_file}"
        )
    apart = float(np.abs(made - person.vertices).max())
    rounding = float(np.spacing(np.abs(person.vertices).max()))  # of a float32 far from the camera
    if not apart < _SAME_BODY_M + 2 * rounding:
        raise InputError(
            f"the body model gives vertices {1000 * apart:.0f} mm from those of the result: "
            f"{give_file}"
        )
    rest = model.kinematics.rest_joints(shape)[0].numpy()
    coefficients = model.skin.with_correctives(shape, rotations)
    directions = model.skin.directions[: coefficients.shape[1]]
    vertices = (
        model.skin.template + torch.einsum("d,dcv->cv", coefficients[0], directions)
    ).T.numpy()
    bind = (
        np.tile(np.eye(3), (55, 1, 1))
        if model.kinematics.bind_rot is None
        else model.kinematics.bind_rot.numpy()
    )
    inverse = np.tile(np.eye(4), (55, 1, 1))
    inverse[:, :3, :3] = bind
    inverse[:, :3, 3] = -(bind @ rest[..., None])[..., 0]
    offsets = rest.copy()
    parents = np.array(PARENTS[1:])
    offsets[1:] = (bind[parents] @ (rest[1:] - rest[parents])[..., None])[..., 0]
    local = rotations[0].numpy().copy()
    matrix = frame.from_camera
    local[0] = matrix[:3, :3] @ local[0]
    offsets[0] = matrix[:3, :3] @ (rest[0] + transl[0].numpy()) + matrix[:3, 3]
    weights = model.skin.weights.T.numpy()
    return Rig(
        JOINT_NAMES, PARENTS, vertices, model.faces.numpy(), weights, inverse, local, offsets
    )


def rigs(request: ExportRequest) -> list[tuple[int, Rig]]:
    """Return index and rig of the people of a request."""
    if not request.people:
        return []
    model = body_of_result(request.result, request.body_file)
    with limited_threads():
        return [
            (index, pose_rig(model, person, request.frame)) for index, person in request.chosen()
        ]
