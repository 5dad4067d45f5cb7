"""Errors of body poses: larger along the line of sight, correlated within a limb, larger for hidden
bones.

An image shows the direction of a bone in the image plane. The tilt out of the plane is visible only
as foreshortening, which hardly changes at small tilts. Errors about the two axes across the line of
sight are therefore larger than about the line of sight. Errors apply to bones in the camera frame,
so they do not add up along a limb, but each limb has a common part.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import JOINT_NAMES, PARENTS
from physic_mock.noise import HIDDEN_FACTOR, LEAN_DEG, LIMB_SHARE, PLANE_DEG, TRUNK_FACTOR

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from physic_core.types import BoolArray, FloatArray

BONES = 22
"""Number of body joints; each rotates the bone that follows it."""

_ARM = ("shoulder", "elbow", "wrist")
_LEG = ("hip", "knee", "ankle", "foot")


def _limb(joint: str) -> str:
    """Return the limb of a joint."""
    side, _, name = joint.partition("_")
    if name in _ARM:
        return f"{side} arm"
    return f"{side} leg" if name in _LEG else "trunk"


LIMBS = tuple(_limb(name) for name in JOINT_NAMES[:BONES])
"""Limb of each bone."""


def line_of_sight_axes(point: FloatArray) -> FloatArray:
    """Return orthonormal rows (3, 3): two axes across the line of sight to a point (3,), and the
    line of sight.
    """
    line = point / np.linalg.norm(point)
    across = np.cross([0.0, 1.0, 0.0], line)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(line, across), line])


_LIMB_NUMBER = np.array([sorted(set(LIMBS)).index(limb) for limb in LIMBS])

_FIRST_CHILD = np.array(
    [PARENTS.index(j, 0, BONES) if j in PARENTS[:BONES] else j for j in range(BONES)]
)


def draw_bone_errors(
    sight: FloatArray, joints_visible: BoolArray, size: float, rng: np.random.Generator
) -> FloatArray:
    """Draw the errors of one person's bones as rotation vectors (22, 3), camera frame, radians; 0
    for the root.

    Args:
        sight: result of :func:`line_of_sight_axes`.
        joints_visible: (J,) bool; a bone is hidden if the joint at its end is.
        size: factor on all errors.
        rng: random generator.
    """
    common = rng.normal(size=(len(set(LIMBS)), 3))
    own = rng.normal(size=(BONES, 3))
    draws = np.sqrt(LIMB_SHARE) * common[_LIMB_NUMBER] + np.sqrt(1 - LIMB_SHARE) * own
    factor = np.where(joints_visible[_FIRST_CHILD], 1.0, HIDDEN_FACTOR)
    factor = factor * np.where(np.array(LIMBS) == "trunk", TRUNK_FACTOR, 1.0)
    sigmas = np.radians([size * LEAN_DEG, size * LEAN_DEG, size * PLANE_DEG])
    errors: FloatArray = (draws * sigmas) @ sight * factor[:, None]
    errors[0] = 0.0
    return errors


def depth_flip(bone: FloatArray, sight: FloatArray) -> Rotation:
    """Return the rotation that mirrors the direction of a bone (3,) in the plane across the line of
    sight (3,) unit.

    The bone keeps its place in the image, and points away from the camera if it pointed towards it.
    """
    from scipy.spatial.transform import Rotation

    direction = bone / np.linalg.norm(bone)
    along = float(direction @ sight)
    axis = np.cross(direction, sight)
    length = np.linalg.norm(axis)
    if length < 1e-6:  # along the line of sight, where it has no place in the image to keep
        return Rotation.identity()
    return Rotation.from_rotvec(-2 * np.arcsin(np.clip(along, -1, 1)) * axis / length)


def camera_rotations(local: FloatArray) -> list[Rotation]:
    """Convert rotation vectors (22, 3) relative to the parents to bone rotations in the camera
    frame.
    """
    from scipy.spatial.transform import Rotation

    turns: list[Rotation] = []
    for j in range(BONES):
        own = Rotation.from_rotvec(local[j])
        turns.append(own if j == 0 else turns[PARENTS[j]] * own)
    return turns


def local_rotations(seen: list[Rotation]) -> FloatArray:
    """Convert bone rotations in the camera frame to rotation vectors (22, 3) relative to the
    parents.
    """
    local = [seen[0].as_rotvec()]
    local += [(seen[PARENTS[j]].inv() * seen[j]).as_rotvec() for j in range(1, BONES)]
    return np.stack(local)
