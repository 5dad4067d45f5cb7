"""Construction of SMPL-X poses limb by limb, as rotation vectors.

A T-pose is zero; the body faces +z, its left hand lies on +x, y is up. The joints' own axes are the body's axes, so
bends about one axis along a limb add up.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from physic_core.body import JOINT_INDEX
from physic_core.body.joints import JOINT_NAMES, PARENTS

if TYPE_CHECKING:
    from physic_core.types import FloatArray

__all__ = ["PoseBuilder"]

_SIDES = (("left", 1.0), ("right", -1.0))
_SIGN = dict(_SIDES)
_FINGERS = ("index", "middle", "pinky", "ring")


class PoseBuilder:
    """Pose under construction; limbs are set by direction, not by joint angles.

    Directions are in the body frame: x to the person's left, y up, z forward. Positive angles and ``x`` of a limb point
    outwards on both sides.

    Attributes:
        pose: (55, 3) rotation vectors, radians.
    """

    def __init__(self, *root: tuple[float, float, float]) -> None:
        self.pose = np.zeros((55, 3))
        _set(self.pose, "pelvis", *root)

    def trunk(self, lean: float = 0.0, twist: float = 0.0, side: float = 0.0) -> PoseBuilder:
        """Bend the spine forward, twist it to the left and bend it to the left; degrees, summed over its joints."""
        for joint, share in (("spine1", 0.3), ("spine2", 0.4), ("spine3", 0.3)):
            _set(self.pose, joint, (share * lean, share * twist, -share * side))
        return self

    def head(self, nod: float = 0.0, turn: float = 0.0, tilt: float = 0.0) -> PoseBuilder:
        """Nod forward, turn to the left and tilt to the left; degrees, divided between neck and head."""
        _set(self.pose, "neck", (0.5 * nod, 0.45 * turn, -0.5 * tilt))
        _set(self.pose, "head", (0.5 * nod, 0.55 * turn, -0.5 * tilt))
        return self

    def leg(
        self, side: str, flex: float, knee: float, spread: float = 0.0, turn: float = 0.0, apart: float = 0.0
    ) -> PoseBuilder:
        """Set the direction of a thigh and the bend of its knee.

        Args:
            side: "left" or "right".
            flex: degrees of the thigh forward of straight down.
            knee: degrees.
            spread: degrees outwards about the vertical, of a raised thigh.
            turn: degrees about the thigh itself, toes outwards (a bent shin goes inwards).
            apart: degrees outwards of a hanging thigh.
        """
        sign = _SIGN[side]
        thigh = _about(1, sign * spread) * _about(2, sign * apart) * _about(0, -flex) * _about(1, sign * turn)
        self._world(f"{side}_hip", thigh)
        _set(self.pose, f"{side}_knee", (knee, 0, 0))
        return self

    def foot(self, side: str, out: float = 0.0, raised: float = 0.0) -> PoseBuilder:
        """Set the orientation of a foot on level ground: toes outwards and heel raised, degrees."""
        self._world(f"{side}_ankle", _about(1, _SIGN[side] * out) * _about(0, raised))
        return self

    def ankle(self, side: str, point: float = 0.0, roll: float = 0.0) -> PoseBuilder:
        """Bend an ankle relative to its shin: toes pointed, sole rolled outwards, degrees."""
        _set(self.pose, f"{side}_ankle", (point, 0, 0), (0, 0, _SIGN[side] * roll))
        return self

    def toes(self, side: str, up: float) -> PoseBuilder:
        """Bend the toes up, degrees."""
        _set(self.pose, f"{side}_foot", (-up, 0, 0))
        return self

    def arm(
        self,
        side: str,
        upper: tuple[float, float, float],
        fore: tuple[float, float, float],
        palm: tuple[float, float, float] | None = None,
        wrist: float = 0.0,
    ) -> PoseBuilder:
        """Set the directions of an upper arm and a forearm; the elbow axis follows from both.

        Args:
            side: "left" or "right".
            upper: direction, x outwards.
            fore: direction, x outwards.
            palm: where the palm looks, x outwards; as the elbow has it where None. Forearm and wrist share the twist.
            wrist: degrees that the hand bends to its back.
        """
        sign = _SIGN[side]
        along, beyond = (_unit(np.array(d) * (sign, 1, 1)) for d in (upper, fore))
        across = beyond - (beyond @ along) * along
        if np.linalg.norm(across) < 1e-2:
            across = np.array([0.0, 0.0, 1.0]) - along[2] * along
        depth = _unit(across)
        frame = Rotation.from_matrix(np.stack([sign * along, np.cross(depth, sign * along), depth], axis=1))
        bend = float(np.degrees(np.arctan2(beyond @ depth, beyond @ along)))
        # Raised arms take the shoulder girdle with them.
        lift = 18 * max(0.0, float(along[1])) + 6
        _set(self.pose, f"{side}_collar", (0, 0, sign * (lift - 6)), (0, -sign * 8 * max(0.0, float(along[2])), 0))
        self._world(f"{side}_shoulder", frame)
        forearm = frame * _about(1, -sign * bend)
        twist = 0.0
        if palm is not None:
            wanted = forearm.inv().apply(_unit(np.array(palm) * (sign, 1, 1)))
            # The palm looks along -y; a turn about x by t carries it to (0, -cos t, -sin t).
            twist = float(np.clip(np.degrees(np.arctan2(-wanted[2], -wanted[1])), -85, 85))
        elbow = _about(1, -sign * bend) * _about(0, 0.65 * twist)
        self.pose[JOINT_INDEX[f"{side}_elbow"]] = elbow.as_rotvec()
        _set(self.pose, f"{side}_wrist", (0.35 * twist, 0, 0), (0, 0, sign * wrist))
        return self

    def fingers(self, side: str, curl: float, rng: np.random.Generator) -> PoseBuilder:
        """Curl the fingers of a hand by about ``curl`` degrees per joint."""
        sign = _SIGN[side]
        for finger in _FINGERS:
            own = curl * rng.uniform(0.8, 1.2)
            for k in (1, 2, 3):
                _set(self.pose, f"{side}_{finger}{k}", (0, 0, -sign * own * rng.uniform(0.85, 1.15)))
        _set(self.pose, f"{side}_thumb2", (0, -sign * curl / 2, 0))
        _set(self.pose, f"{side}_thumb3", (0, -sign * curl / 2, 0))
        return self

    def global_rotation(self, joint: str) -> Rotation:
        """Return a joint's rotation relative to the body frame."""
        chain, index = Rotation.identity(), JOINT_INDEX[joint]
        while index >= 0:
            chain = Rotation.from_rotvec(self.pose[index]) * chain
            index = PARENTS[index]
        return chain

    def _world(self, joint: str, wanted: Rotation) -> None:
        """Set a joint so that its rotation relative to the body frame is ``wanted``."""
        parent = JOINT_NAMES[PARENTS[JOINT_INDEX[joint]]]
        self.pose[JOINT_INDEX[joint]] = (self.global_rotation(parent).inv() * wanted).as_rotvec()


def _about(axis: int, degrees: float) -> Rotation:
    """Return the rotation about axis 0, 1 or 2 by an angle in degrees."""
    turn = np.zeros(3)
    turn[axis] = np.radians(degrees)
    return Rotation.from_rotvec(turn)


def _unit(vector: FloatArray) -> FloatArray:
    """Normalise a vector."""
    unit: FloatArray = vector / np.linalg.norm(vector)
    return unit


def _set(pose: FloatArray, joint: str, *turns: tuple[float, float, float]) -> None:
    """Set a joint to a product of rotation vectors in degrees, outermost first."""
    total = Rotation.identity()
    for turn in turns:
        total = total * Rotation.from_rotvec(np.radians(turn))
    pose[JOINT_INDEX[joint]] = total.as_rotvec()
