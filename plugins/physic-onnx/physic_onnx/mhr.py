"""Meta's body model MHR as its TorchScript file: the surface and the joints of bodies from their
parameters.

The file takes a shape (45), parameters of pose and size (204) and an expression (72). It returns
vertices in centimetres and, for each of its 127 joints, place, rotation as a quaternion x y z w,
and scale; y is up. Its body at rest has raised arms (A-pose). This was read in code that runs it;
no published file was run here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body.joints import JOINT_INDEX, NUM_JOINTS, PARENTS
from physic_core.errors import BackendError

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.types import FloatArray, IntArray

_EXPRESSIONS = 72
_TO_CAMERA = np.diag([1.0, -1.0, -1.0])
_TRUNK = {
    "pelvis": "root",
    "spine1": "c_spine1",
    "spine2": "c_spine2",
    "spine3": "c_spine3",
    "neck": "c_neck",
    "head": "c_head",
}
_LIMBS = {
    "collar": "clavicle",
    "shoulder": "uparm",
    "elbow": "lowarm",
    "wrist": "wrist",
    "hip": "upleg",
    "knee": "lowleg",
    "ankle": "foot",
    "foot": "ball",
}
JOINT_OF_MHR = {
    **_TRUNK,
    **{
        f"{side}_{ours}": f"{side[0]}_{own}"
        for side in ("left", "right")
        for ours, own in _LIMBS.items()
    },
}
"""MHR's joint by the name of SMPL-X's."""
_PLACED = tuple(
    f"{side}_{name}" for side in ("left", "right") for name in _LIMBS if name != "collar"
)
"""Joints that are at the same place of both bodies; those of the trunk are not."""
_BONE_ENDS = {"shoulder": "elbow", "elbow": "wrist", "wrist": None, "hip": "knee", "knee": "ankle"}
"""Joint at whose end a bone points to the next; the hand at rest points where its forearm does."""
_TPOSE = {
    "shoulder": (1.0, 0.0, 0.0),
    "elbow": (1.0, 0.0, 0.0),
    "hip": (0.0, -1.0, 0.0),
    "knee": (0.0, -1.0, 0.0),
}
"""Direction of the left bones in the T-pose; right ones are their mirror images."""


@dataclass(frozen=True)
class MhrBodies:
    """Posed MHR bodies of N people about their own origin, metres, camera axes.

    Attributes:
        vertices: (N, V, 3).
        joints: (N, 55, 3) of SMPL-X; NaN where MHR has no joint at the same place.
        rotvecs: (N, 22, 3) of SMPL-X's joints relative to their parents and the T-pose; root first.
    """

    vertices: FloatArray
    joints: FloatArray
    rotvecs: FloatArray


class MhrModel:
    """MHR on a device.

    Attributes:
        faces: (F, 3) vertices of each triangle.
    """

    def __init__(self, path: Path, device: str = "cpu") -> None:
        """Open the file.

        Raises:
            BackendError: it is not MHR.
        """
        from physic_core.adapters.devices import check_device
        from physic_core.adapters.networks import open_torchscript

        check_device(device)
        self._device = device
        self._network = open_torchscript(path, device)
        try:
            names = list(self._network.get_joint_names())
            self.faces: IntArray = (
                self._network.character_torch.mesh.faces.cpu().numpy().astype(np.int32)
            )
            self._rows = [names.index(name) for name in JOINT_OF_MHR.values()]
        except (AttributeError, ValueError) as error:
            raise BackendError(
                f"{path} is not the body model MHR ({error}): take mhr_model.pt of the releases of "
                "https://github.com/facebookresearch/MHR"
            ) from error
        _, places, turns = self._ask(np.zeros((1, 45), np.float32), np.zeros((1, 204), np.float32))
        self._rest = np.swapaxes(turns[0], -1, -2) @ _swings_from_tpose(places[0])

    def pose(self, shape: FloatArray, parameters: FloatArray) -> MhrBodies:
        """Return the bodies of shapes (N, 45) and parameters of pose and size (N, 204)."""
        from scipy.spatial.transform import Rotation

        vertices, places, turns = self._ask(shape, parameters)
        count = len(vertices)
        ours = [JOINT_INDEX[name] for name in JOINT_OF_MHR]
        joints = np.full((count, NUM_JOINTS, 3), np.nan, np.float32)
        placed = [list(JOINT_OF_MHR).index(name) for name in _PLACED]
        joints[:, [ours[i] for i in placed]] = places[:, placed] @ _TO_CAMERA
        world = np.empty((count, len(ours), 3, 3))
        world[:, ours] = _TO_CAMERA @ turns @ self._rest
        local = world.copy()
        local[:, 1:] = (
            np.swapaxes(world[:, [PARENTS[joint] for joint in range(1, len(ours))]], -1, -2)
            @ world[:, 1:]
        )
        rotvecs = Rotation.from_matrix(local.reshape(-1, 3, 3)).as_rotvec().reshape(count, -1, 3)
        return MhrBodies(np.asarray(vertices @ _TO_CAMERA, np.float32), joints, rotvecs)

    def _ask(
        self, shape: FloatArray, parameters: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return vertices (N, V, 3), and places (N, 22, 3) and rotations (N, 22, 3, 3) of joints;
        metres, y up.
        """
        import torch
        from scipy.spatial.transform import Rotation

        from physic_core.adapters.networks import to_numpy

        given: list[Any] = [shape, parameters, np.zeros((len(shape), _EXPRESSIONS))]
        with torch.inference_mode():
            found, states = self._network(
                *(
                    torch.from_numpy(np.asarray(value, np.float32)).to(self._device)
                    for value in given
                )
            )
        vertices = to_numpy(found)
        states = to_numpy(states)[:, self._rows]
        turns = Rotation.from_quat(states[..., 3:7].reshape(-1, 4)).as_matrix()
        return vertices / 100, states[..., :3] / 100, turns.reshape(*states.shape[:2], 3, 3)


def _swings_from_tpose(places: FloatArray) -> FloatArray:
    """Return the rotations (22, 3, 3) of the bones of a body at rest from the T-pose.

    Args:
        places: (22, 3) of its joints, in the order of :data:`JOINT_OF_MHR`.
    """
    from scipy.spatial.transform import Rotation

    names = list(JOINT_OF_MHR)
    swings = np.tile(np.eye(3), (len(names), 1, 1))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for name, end in _BONE_ENDS.items():
            if end is None:
                swings[names.index(f"{side}_{name}")] = swings[names.index(f"{side}_elbow")]
                continue
            bone = places[names.index(f"{side}_{end}")] - places[names.index(f"{side}_{name}")]
            bone = bone / np.linalg.norm(bone)
            straight = np.array(_TPOSE[name]) * [sign, 1, 1]
            axis = np.cross(straight, bone)
            angle = np.arctan2(np.linalg.norm(axis), straight @ bone)
            turn = Rotation.from_rotvec(axis / max(float(np.linalg.norm(axis)), 1e-9) * angle)
            swings[names.index(f"{side}_{name}")] = turn.as_matrix()
    return swings
