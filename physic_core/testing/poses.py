"""Postures of the worlds' people, as rotation vectors of the SMPL-X joints, with seeded variety.

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

__all__ = ["Posture", "bend_leg", "sitting", "standing", "toward"]

_SIDES = (("left", 1.0), ("right", -1.0))
_SIGN = dict(_SIDES)
_FINGERS = ("index", "middle", "pinky", "ring")


class Posture:
    """A pose under construction: limbs are given by where they point, not by joint angles.

    Directions are in the facing frame: x to the person's left, y up, z forward. ``sign`` below is 1 for the left side
    and -1 for the right, so that positive angles and ``x`` always go outwards.

    Attributes:
        pose: (55, 3) rotation vectors, radians.
    """

    def __init__(self, *root: tuple[float, float, float]) -> None:
        self.pose = np.zeros((55, 3))
        _set(self.pose, "pelvis", *root)

    def trunk(self, lean: float = 0.0, twist: float = 0.0, side: float = 0.0) -> Posture:
        """Bend the spine forward, turn it to the left and bend it to the left, degrees in all."""
        for joint, share in (("spine1", 0.3), ("spine2", 0.4), ("spine3", 0.3)):
            _set(self.pose, joint, (share * lean, share * twist, -share * side))
        return self

    def head(self, nod: float = 0.0, turn: float = 0.0, tilt: float = 0.0) -> Posture:
        """Nod forward, turn to the left and tilt to the left, degrees, shared by neck and head."""
        _set(self.pose, "neck", (0.5 * nod, 0.45 * turn, -0.5 * tilt))
        _set(self.pose, "head", (0.5 * nod, 0.55 * turn, -0.5 * tilt))
        return self

    def leg(
        self, side: str, flex: float, knee: float, spread: float = 0.0, turn: float = 0.0, apart: float = 0.0
    ) -> Posture:
        """Point a thigh and bend its knee.

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

    def foot(self, side: str, out: float = 0.0, raised: float = 0.0) -> Posture:
        """Turn a foot as it stands on level ground, toes outwards and heel raised by so many degrees."""
        self._world(f"{side}_ankle", _about(1, _SIGN[side] * out) * _about(0, raised))
        return self

    def ankle(self, side: str, point: float = 0.0, roll: float = 0.0) -> Posture:
        """Bend an ankle against its shin: toes pointed, sole rolled outwards, degrees."""
        _set(self.pose, f"{side}_ankle", (point, 0, 0), (0, 0, _SIGN[side] * roll))
        return self

    def toes(self, side: str, up: float) -> Posture:
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
    ) -> Posture:
        """Point an upper arm and a forearm; the elbow's hinge follows from both.

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

    def fingers(self, side: str, curl: float, rng: np.random.Generator) -> Posture:
        """Curl the fingers by about so many degrees a joint."""
        sign = _SIGN[side]
        for finger in _FINGERS:
            own = curl * rng.uniform(0.8, 1.2)
            for k in (1, 2, 3):
                _set(self.pose, f"{side}_{finger}{k}", (0, 0, -sign * own * rng.uniform(0.85, 1.15)))
        _set(self.pose, f"{side}_thumb2", (0, -sign * curl / 2, 0))
        _set(self.pose, f"{side}_thumb3", (0, -sign * curl / 2, 0))
        return self

    def turned(self, joint: str) -> Rotation:
        """A joint's rotation in the frame of the root's turn."""
        chain, index = Rotation.identity(), JOINT_INDEX[joint]
        while index >= 0:
            chain = Rotation.from_rotvec(self.pose[index]) * chain
            index = PARENTS[index]
        return chain

    def _world(self, joint: str, wanted: Rotation) -> None:
        parent = JOINT_NAMES[PARENTS[JOINT_INDEX[joint]]]
        self.pose[JOINT_INDEX[joint]] = (self.turned(parent).inv() * wanted).as_rotvec()


def toward(start: FloatArray, end: FloatArray) -> tuple[float, float, float]:
    """Unit direction from one point to another."""
    x, y, z = _unit(np.asarray(end, float) - np.asarray(start, float))
    return float(x), float(y), float(z)


def _about(axis: int, degrees: float) -> Rotation:
    turn = np.zeros(3)
    turn[axis] = np.radians(degrees)
    return Rotation.from_rotvec(turn)


def _unit(vector: FloatArray) -> FloatArray:
    unit: FloatArray = vector / np.linalg.norm(vector)
    return unit


def standing(rng: np.random.Generator) -> FloatArray:
    """Upright, feet a little apart and flat, arms hanging or bent: (55, 3) radians."""
    pose = np.zeros((55, 3))
    apart = rng.uniform(2, 6)
    for side, sign in _SIDES:
        _set(pose, f"{side}_hip", (0, 0, sign * apart))
        _flatten_foot(pose, side, toe_out=sign * rng.uniform(2, 12))
    _trunk(pose, rng, lean=rng.uniform(-2, 4))
    for side, sign in _SIDES:
        lowered, bent = rng.uniform(60, 68), rng.uniform(12, 35)
        if rng.random() < 0.3:  # a bent arm now and then
            lowered, bent = rng.uniform(48, 56), rng.uniform(55, 85)
        _arm(pose, side, sign, rng.uniform(-4, 12), lowered, bent, rng.uniform(0, 15), rng)
    _hands(pose, rng)
    return pose


def sitting(rng: np.random.Generator, thigh: float) -> FloatArray:
    """On a seat, shins upright, soles flat, forearms over the thighs: (55, 3) radians.

    Args:
        rng: draws the spread of the knees, the trunk, the arms and the fingers.
        thigh: bend of the hips, degrees; 90 is a level thigh bone.
    """
    pose = np.zeros((55, 3))
    spread = rng.uniform(5, 12)
    for side, sign in _SIDES:
        # The leg swings up in its own plane, turned by the spread, and the knee undoes exactly that swing.
        _set(pose, f"{side}_hip", (0, sign * spread, 0), (-thigh, 0, 0))
        _set(pose, f"{side}_knee", (thigh, 0, 0))
        _flatten_foot(pose, side, toe_out=sign * spread)
    _trunk(pose, rng, lean=rng.uniform(2, 10))
    for side, sign in _SIDES:
        _arm(pose, side, sign, rng.uniform(14, 24), rng.uniform(66, 72), rng.uniform(40, 55), rng.uniform(25, 40), rng)
    _hands(pose, rng)
    return pose


def bend_leg(pose: FloatArray, side: str, degrees: float) -> FloatArray:
    """The pose with one knee bent further, the hip following by half, and the foot as flat as before."""
    hip, knee, ankle = (JOINT_INDEX[f"{side}_{name}"] for name in ("hip", "knee", "ankle"))
    foot = _turn(pose, f"{side}_hip", f"{side}_knee", f"{side}_ankle")
    bent = pose.copy()
    for joint, angle in ((hip, -degrees / 2), (knee, degrees)):
        bent[joint] = (Rotation.from_rotvec(pose[joint]) * Rotation.from_rotvec((np.radians(angle), 0, 0))).as_rotvec()
    bent[ankle] = (_turn(bent, f"{side}_hip", f"{side}_knee").inv() * foot).as_rotvec()
    return bent


def _turn(pose: FloatArray, *joints: str) -> Rotation:
    """The product of joints' rotations, outermost first."""
    total = Rotation.identity()
    for joint in joints:
        total = total * Rotation.from_rotvec(pose[JOINT_INDEX[joint]])
    return total


def _set(pose: FloatArray, joint: str, *turns: tuple[float, float, float]) -> None:
    """Turn a joint by rotation vectors in degrees, outermost first."""
    total = Rotation.identity()
    for turn in turns:
        total = total * Rotation.from_rotvec(np.radians(turn))
    pose[JOINT_INDEX[joint]] = total.as_rotvec()


def _flatten_foot(pose: FloatArray, side: str, toe_out: float) -> None:
    """Turn the ankle so that the foot stands as in the T-pose, toes ``toe_out`` degrees about y."""
    leg = _turn(pose, f"{side}_hip", f"{side}_knee")
    wanted = Rotation.from_rotvec((0, np.radians(toe_out), 0))
    pose[JOINT_INDEX[f"{side}_ankle"]] = (leg.inv() * wanted).as_rotvec()


def _trunk(pose: FloatArray, rng: np.random.Generator, lean: float) -> None:
    """Bend forward by ``lean`` degrees in all, twist a little, turn the head."""
    twist = rng.uniform(-8, 8)
    for joint in ("spine1", "spine2", "spine3"):
        _set(pose, joint, (lean / 3, twist / 3, 0))
    _set(pose, "neck", (rng.uniform(-4, 8), rng.uniform(-12, 12), 0))
    _set(pose, "head", (rng.uniform(-4, 6), rng.uniform(-12, 12), 0))


def _arm(
    pose: FloatArray,
    side: str,
    sign: float,
    forward: float,
    lowered: float,
    bent: float,
    inward: float,
    rng: np.random.Generator,
) -> None:
    """Lower the arm from the T-pose, swing it to the front, bend the elbow, turn the forearm inwards; in degrees."""
    _set(pose, f"{side}_shoulder", (-forward, 0, 0), (0, 0, -sign * lowered), (inward, 0, 0))
    # In the T-pose the palms face down and the elbow bends about y: the left forearm goes from +x to +z.
    _set(pose, f"{side}_elbow", (0, -sign * bent, 0))
    _set(pose, f"{side}_wrist", (0, 0, -sign * rng.uniform(-5, 10)))


def _hands(pose: FloatArray, rng: np.random.Generator) -> None:
    """Relaxed fingers, curled towards the palm."""
    for side, sign in _SIDES:
        curl = rng.uniform(10, 25)
        for finger in _FINGERS:
            for k in (1, 2, 3):
                _set(pose, f"{side}_{finger}{k}", (0, 0, -sign * curl * rng.uniform(0.8, 1.2)))
        _set(pose, f"{side}_thumb2", (0, -sign * curl / 2, 0))
