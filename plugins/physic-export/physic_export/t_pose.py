"""The T-pose of a person, from which other programs retarget."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.visual.rig import Rig


def t_pose(rig: Rig, up: NDArray[np.float64]) -> Rig:
    """Return a rig in the T-pose: upright, at the place of the pose, facing as it does, with the soles at height 0.

    Args:
        rig: in the pose.
        up: (3,) unit vector, an axis of the frame.
    """
    forward = rig.rotations[0] @ [0.0, 0.0, 1.0]
    forward = forward - (forward @ up) * up
    if np.linalg.norm(forward) < 1e-6:  # a body that lies: its head points where it would face
        forward = rig.rotations[0] @ [0.0, 1.0, 0.0]
        forward = forward - (forward @ up) * up
    forward = forward / np.linalg.norm(forward)
    rotations = np.tile(np.eye(3), (len(rig.names), 1, 1))
    rotations[0] = np.stack([np.cross(up, forward), up, forward], 1)
    standing = replace(rig, rotations=rotations)
    offsets = rig.offsets.copy()
    offsets[0] = offsets[0] - (skinned(standing) @ up).min() * up
    return replace(standing, offsets=offsets)


def skinned(rig: Rig) -> NDArray[np.float64]:
    """Return the vertices (V, 3) of a rig in its pose."""
    bones = (rig.world() @ rig.inverse_bind)[:, :3]
    moved = rig.weights @ bones.reshape(len(bones), 12)
    points: NDArray[np.float64] = np.einsum(
        "vij,vj->vi", moved.reshape(-1, 3, 4), np.pad(rig.vertices, ((0, 0), (0, 1)), constant_values=1.0)
    )
    return points
