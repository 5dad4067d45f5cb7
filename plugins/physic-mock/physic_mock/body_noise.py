"""How estimators get postures wrong: in depth more than in the picture, limb by limb, and most where nothing is seen.

A picture tells where bones point in its plane. How far they lean out of it shows only in their foreshortening, which
is flat where a bone lies in the plane; so an error turns bones about the two axes across the line of sight more than
about the line of sight itself. Errors are of bones as the camera sees them, and so do not add up along a limb, but
part of each is shared by the whole limb.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import JOINT_NAMES, PARENTS

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from physic_core.types import BoolArray, FloatArray

__all__ = ["BONES", "LIMBS", "hidden_bones", "leaning_bones", "local_turns", "seen_turns", "sight_frame"]

BONES = 22
"""Body joints; each turns the bone that hangs on it."""

_TRUNK = ("pelvis", "spine1", "spine2", "spine3", "neck", "head", "left_collar", "right_collar")
_ENDS = {"hip": "leg", "knee": "leg", "ankle": "leg", "foot": "leg", "shoulder": "arm", "elbow": "arm", "wrist": "arm"}


def _limb(joint: str) -> str:
    side, _, name = joint.partition("_")
    return "trunk" if joint in _TRUNK else f"{side} {_ENDS[name]}"


LIMBS = tuple(_limb(name) for name in JOINT_NAMES[:BONES])
"""Limb that each bone belongs to."""

_LIMB_NUMBER = np.array([sorted(set(LIMBS)).index(limb) for limb in LIMBS])
_FIRST_CHILD = np.array([PARENTS.index(j, 0, BONES) if j in PARENTS[:BONES] else j for j in range(BONES)])


def sight_frame(point: FloatArray) -> FloatArray:
    """(3, 3) orthonormal rows: two axes across the line of sight to a point (3,), and the line itself."""
    line = point / np.linalg.norm(point)
    across = np.cross([0.0, 1.0, 0.0], line)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(line, across), line])


def hidden_bones(joints_visible: BoolArray) -> BoolArray:
    """(22,) bool from (55,): bones whose far end the photo does not show."""
    ends: BoolArray = joints_visible[_FIRST_CHILD]
    return ~ends


def leaning_bones(
    sight: FloatArray,
    hidden: BoolArray,
    lean_deg: float,
    plane_deg: float,
    limb_share: float,
    hidden_factor: float,
    trunk_factor: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Errors of one person's bones as rotation vectors (22, 3) in the camera's axes, radians; the root has none.

    Args:
        sight: from :func:`sight_frame`.
        hidden: (22,) bool.
        lean_deg: standard deviation about each of the two axes across the line of sight.
        plane_deg: about the line of sight.
        limb_share: of the variance that all bones of a limb share.
        hidden_factor: on the errors of hidden bones.
        trunk_factor: on those of the trunk, neck and head.
        rng: draws.
    """
    common, own = rng.normal(size=(len(set(LIMBS)), 3)), rng.normal(size=(BONES, 3))
    draws = np.sqrt(limb_share) * common[_LIMB_NUMBER] + np.sqrt(1 - limb_share) * own
    factor = np.where(hidden, hidden_factor, 1.0) * np.where(np.array(LIMBS) == "trunk", trunk_factor, 1.0)
    errors: FloatArray = (draws * np.radians([lean_deg, lean_deg, plane_deg])) @ sight * factor[:, None]
    errors[0] = 0.0
    return errors


def seen_turns(local: FloatArray) -> list[Rotation]:
    """Rotation vectors (22, 3) relative to each parent -> rotations of the bones in the camera's axes."""
    from scipy.spatial.transform import Rotation

    turns: list[Rotation] = []
    for j in range(BONES):
        own = Rotation.from_rotvec(local[j])
        turns.append(own if j == 0 else turns[PARENTS[j]] * own)
    return turns


def local_turns(seen: list[Rotation]) -> FloatArray:
    """The inverse of :func:`seen_turns`: (22, 3) rotation vectors."""
    local = [seen[0].as_rotvec()]
    local += [(seen[PARENTS[j]].inv() * seen[j]).as_rotvec() for j in range(1, BONES)]
    return np.stack(local)
