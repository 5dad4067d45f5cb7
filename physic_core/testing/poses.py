"""Postures of the worlds' people, as rotation vectors of the SMPL-X joints, with seeded variety.

A T-pose is zero; the body faces +z, its left hand lies on +x, y is up. The joints' own axes are the body's axes, so
bends about one axis along a limb add up.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from physic_core.body import JOINT_INDEX

if TYPE_CHECKING:
    from physic_core.types import FloatArray

__all__ = ["bend_leg", "sitting", "standing"]

_SIDES = (("left", 1.0), ("right", -1.0))
_FINGERS = ("index", "middle", "pinky", "ring")


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
