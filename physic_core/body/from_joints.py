"""Rotations of a whole body from nothing but where its joints are, some of them unknown.

Trunk and head follow from frames of long sticks (hips, shoulders, spine), since where joints inside the trunk lie is a
matter of convention; limbs from the direction of each bone, and from the axis about which knee and elbow bend; where a
limb is straight, from the foot, or by the shortest way from the trunk.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from physic_core.body.joints import JOINT_INDEX, PARENTS, joint_pair
from physic_core.body.rotations import (
    cross,
    exp,
    frame_from_axes,
    nearest_rotation,
    rotate,
    rotation_between,
    slerp,
    swing_twist,
    unit,
)

__all__ = ["enough", "numbers", "rotations_of"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

_HIPS, _KNEES, _ANKLES, _FEET = (joint_pair(name) for name in ("hip", "knee", "ankle", "foot"))
_COLLARS, _SHOULDERS, _ELBOWS, _WRISTS = (joint_pair(name) for name in ("collar", "shoulder", "elbow", "wrist"))
_EYES = joint_pair("eye")
_PELVIS, _SPINE1, _SPINE2, _SPINE3 = (JOINT_INDEX[name] for name in ("pelvis", "spine1", "spine2", "spine3"))
_UPPER, _LOWER, _END = [*_HIPS, *_SHOULDERS], [*_KNEES, *_ELBOWS], [*_ANKLES, *_WRISTS]
"""Hips and shoulders, knees and elbows, ankles and wrists; left before right."""
_HINGES = np.array([[1.0, 0, 0], [1.0, 0, 0], [0, -1.0, 0], [0, 1.0, 0]])
"""About which axis of the T-pose each knee and elbow bends."""
_FINGERS = np.arange(25, 55).reshape(2, 5, 3)
"""Side, finger, joint from the base."""
_BENT, _WELL_BENT = 0.15, 0.4
"""Sine of the angle at a hinge below which its axis says nothing, and from which it says all."""
_BY_FOOT, _BY_TRUNK = 1.0, 0.3
"""How much the foot and the trunk say of the axis of a straight limb."""


def enough(known: Bools) -> Bools:
    """(B, 55) bool -> (B,) bool: both hips, and both shoulders or the neck, without which a body has no direction."""
    sound: Bools = known[:, _HIPS].all(1) & (known[:, _SHOULDERS].all(1) | known[:, JOINT_INDEX["neck"]])
    return sound


def numbers(joints: NDArray[np.floating[Any]]) -> Bools:
    """(..., 3) -> (...) bool: which joints are known."""
    known: Bools = np.asarray(np.isfinite(joints).all(-1), bool)
    return known


def rotations_of(joints: Array, rest: Array) -> Array:
    """Rotations of every bone against the T-pose.

    Args:
        joints: (B, 55, 3) metres, NaN where unknown; of bodies with :func:`enough` joints.
        rest: (B, 55, 3) joints of the same body in the T-pose, as far as its shape is known.

    Returns:
        (B, 55, 3, 3); a bone of which nothing is known turns with its parent.
    """
    known = numbers(joints)
    joints = np.where(known[..., None], joints, 0.0)
    world = np.broadcast_to(np.eye(3), (*joints.shape, 3)).copy()
    _turn_trunk(world, joints, rest, known)
    neck = JOINT_INDEX["neck"]
    for shoulder in _SHOULDERS:
        # An unknown shoulder is where it would be on this chest.
        guess = joints[:, neck] + rotate(world[:, _SPINE3], rest[:, shoulder] - rest[:, neck])
        fill = ~known[:, shoulder] & known[:, neck]
        joints[:, shoulder] = np.where(fill[:, None], guess, joints[:, shoulder])
        known[:, shoulder] |= fill
    _turn_head(world, joints, rest, known)
    _turn_limbs(world, joints, rest, known)
    _turn_hands(world, joints, rest, known)
    return world


def _turn_trunk(world: Array, joints: Array, rest: Array, known: Bools) -> None:
    hips, rest_hips = joints[:, _HIPS].mean(1), rest[:, _HIPS].mean(1)
    top, rest_top = _first(joints, rest, known, "neck", *_both(joints, rest, known, _SHOULDERS))
    middle, rest_middle = _first(joints, rest, known, "spine3", top, rest_top)
    middle, rest_middle = _first(joints, rest, known, "spine2", middle, rest_middle)
    low = _frame([_across(joints, rest, _HIPS), (middle - hips, rest_middle - rest_hips)])
    # Of the upper trunk, from the middle of the spine if that is known.
    same = (middle == top).all(-1, keepdims=True)
    base, rest_base = np.where(same, hips, middle), np.where(same, rest_hips, rest_middle)
    wide = _all(known[:, _SHOULDERS])[:, None]
    across, rest_across = _across(joints, rest, _SHOULDERS)
    high = _frame([(np.where(wide, across, rotate(low, rest_across)), rest_across), (top - base, rest_top - rest_base)])
    world[:, _PELVIS], world[:, _SPINE3] = low, high
    world[:, _SPINE1], world[:, _SPINE2] = slerp(low, high, 1 / 3), slerp(low, high, 2 / 3)
    for collar, shoulder in zip(_COLLARS, _SHOULDERS, strict=True):
        # Shoulders are wide or narrow by shape, so only what lifts them or pushes them forward is taken.
        seen = known[:, shoulder]
        middle_of = joints[:, _SHOULDERS].mean(1) - rotate(high, rest[:, _SHOULDERS].mean(1) - rest[:, collar])
        turn = rotation_between(rotate(high, rest[:, shoulder] - rest[:, collar]), joints[:, shoulder] - middle_of)
        world[:, collar] = np.where((seen[:, None] & wide)[..., None], turn @ high, high)


def _turn_head(world: Array, joints: Array, rest: Array, known: Bools) -> None:
    neck, head = JOINT_INDEX["neck"], JOINT_INDEX["head"]
    chest = world[:, _SPINE3]
    way = rotation_between(rotate(chest, rest[:, head] - rest[:, neck]), joints[:, head] - joints[:, neck])
    seen = _all(known[:, [neck, head]])[:, None, None]
    world[:, neck] = np.where(seen, way @ chest, chest)
    looks = _all(known[:, [head, *_EYES]])[:, None, None]
    face = _frame(
        [
            _across(joints, rest, _EYES),
            (joints[:, _EYES].mean(1) - joints[:, head], rest[:, _EYES].mean(1) - rest[:, head]),
        ]
    )
    world[:, head] = np.where(looks, face, world[:, neck])
    # What the head turns more than the chest, the neck turns half of.
    bone = rest[:, head] - rest[:, neck]
    _, angle = swing_twist(np.swapaxes(world[:, neck], -1, -2) @ world[:, head], bone)
    world[:, neck] = world[:, neck] @ exp(0.5 * np.where(looks[..., 0], angle[:, None], 0.0) * unit(bone))
    world[:, [JOINT_INDEX["jaw"], *_EYES]] = world[:, [head]]


def _turn_limbs(world: Array, joints: Array, rest: Array, known: Bools) -> None:
    above = world[:, [_PELVIS, _PELVIS, *_COLLARS]]
    first, second = (rest[:, b] - rest[:, a] for a, b in ((_UPPER, _LOWER), (_LOWER, _END)))
    upper_known = known[:, _UPPER] & known[:, _LOWER]
    lower_known = known[:, _LOWER] & known[:, _END]
    upper = np.where(upper_known[..., None], joints[:, _LOWER] - joints[:, _UPPER], rotate(above, first))
    default = rotation_between(rotate(above, first), upper)
    trunk = rotate(default @ above, _HINGES)
    lower = np.where(lower_known[..., None], joints[:, _END] - joints[:, _LOWER], rotate(default @ above, second))
    bend = cross(unit(upper), unit(lower))
    sine = np.sqrt((bend * bend).sum(-1, keepdims=True))
    tells = np.clip((sine - _BENT) / (_WELL_BENT - _BENT), 0.0, 1.0)
    hint = _BY_TRUNK * trunk
    hint[:, :2] += _BY_FOOT * _axis_by_foot(joints, known, lower[:, :2])
    axis = tells * unit(bend) + (1 - tells) * unit(hint)
    frames = [frame_from_axes(bone, np.broadcast_to(_HINGES, bone.shape)) for bone in (first, second)]
    for bones, seen, frame, rows in ((upper, upper_known, frames[0], _UPPER), (lower, lower_known, frames[1], _LOWER)):
        turn = frame_from_axes(bones, axis) @ np.swapaxes(frame, -1, -2)
        parent = world[:, [PARENTS[row] for row in rows]]
        world[:, rows] = np.where(seen[..., None, None], turn, parent)
    foot = rest[:, _FEET] - rest[:, _ANKLES]
    shin = world[:, _KNEES]
    tread = rotation_between(rotate(shin, foot), joints[:, _FEET] - joints[:, _ANKLES]) @ shin
    steps = (known[:, _FEET] & known[:, _ANKLES])[..., None, None]
    world[:, _ANKLES] = np.where(steps, tread, shin)
    world[:, _FEET] = world[:, _ANKLES]


def _axis_by_foot(joints: Array, known: Bools, shins: Array) -> Array:
    """(B, 2, 3) about which axis the knees would bend, if feet point forward; zero where the foot is unknown."""
    feet = joints[:, _FEET] - joints[:, _ANKLES]
    seen = (known[:, _FEET] & known[:, _ANKLES])[..., None]
    return np.where(seen, unit(cross(feet, shins)), 0.0)


def _turn_hands(world: Array, joints: Array, rest: Array, known: Bools) -> None:
    arms = world[:, _ELBOWS]
    bases = _FINGERS[:, :, 0]
    seen = known[:, bases] & known[:, _WRISTS][..., None]
    stick = joints[:, bases] - joints[:, _WRISTS][:, :, None]
    rest_stick = rest[:, bases] - rest[:, _WRISTS][:, :, None]
    moments = np.einsum("bsf,bsfi,bsfk->bsik", seen.astype(float), stick, rest_stick)
    # Two fingers apart give a frame; the little weight of the forearm decides what they leave open.
    enough_fingers = (seen.sum(-1) >= 2)[..., None, None]
    hand = nearest_rotation(np.where(enough_fingers, moments, np.eye(3)) + np.where(enough_fingers, 1e-6, 0.0) * arms)
    hand = np.where(enough_fingers, hand, arms)
    # Half of how far the palm is turned over happens in the forearm.
    forearm = rest[:, _WRISTS] - rest[:, _ELBOWS]
    _, angle = swing_twist(np.swapaxes(arms, -1, -2) @ hand, forearm)
    world[:, _ELBOWS] = arms @ exp(0.5 * angle[..., None] * unit(forearm))
    world[:, _WRISTS] = hand
    above = np.repeat(hand[:, :, None], 5, axis=2)
    for joint in range(3):
        if joint < 2:
            here, there = _FINGERS[..., joint], _FINGERS[..., joint + 1]
            way = rotate(above, rest[:, there] - rest[:, here])
            told = (known[:, here] & known[:, there])[..., None]
            above = rotation_between(way, np.where(told, joints[:, there] - joints[:, here], way)) @ above
        world[:, _FINGERS[..., joint]] = above


def _all(flags: Bools) -> Bools:
    """(..., n) -> (...)."""
    every: Bools = np.logical_and.reduce(flags, axis=-1)
    return every


def _frame(sticks: list[tuple[Array, Array]]) -> Array:
    """Rotation (B, 3, 3) that best turns directions of the T-pose into what they became, each pair (B, 3)."""
    moments = sum(unit(now)[:, :, None] * unit(rest)[:, None, :] for now, rest in sticks)
    return nearest_rotation(np.asarray(moments))


def _first(joints: Array, rest: Array, known: Bools, name: str, other: Array, rest_other: Array) -> tuple[Array, Array]:
    """A joint and where it rests, or another point where it is unknown."""
    i = JOINT_INDEX[name]
    seen = known[:, i, None]
    return np.where(seen, joints[:, i], other), np.where(seen, rest[:, i], rest_other)


def _both(joints: Array, rest: Array, known: Bools, pair: list[int]) -> tuple[Array, Array]:
    return joints[:, pair].mean(1), rest[:, pair].mean(1)


def _across(joints: Array, rest: Array, pair: list[int]) -> tuple[Array, Array]:
    """From the right to the left joint of a pair, now and in the T-pose."""
    left, right = pair
    return joints[:, left] - joints[:, right], rest[:, left] - rest[:, right]
