"""Fits a body model, part by part and in closed form, to the joints of another body.

In the spirit of fitting SMPL by parts (Sarandi and Pons-Moll's smplfitter): rotations of parts by Kabsch, shape and
translation by ridge regression, alternating. Three things are done otherwise. Hinges count more than joints
inside the trunk, whose place is a convention that differs from model to model. How much it differs is told from what
is left over, so that a model is recovered from its own joints. And limbs are pointed from where they truly begin, so
that what a shape cannot follow does not add up along the arm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physic_core.body.bones import Bones, fit_shape
from physic_core.body.from_joints import numbers, rotations_of
from physic_core.body.joints import JOINT_NAMES, PARENTS, joint_pair
from physic_core.body.rotations import rotate, rotation_between

__all__ = ["Fit", "fit_joints"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

_ROUNDS = 3
_LEAST_LEFT_OVER = 0.02
"""Of what two models may differ by: as well as a model is recovered from its own joints."""
_HIPS, _KNEES, _ANKLES = (joint_pair(name) for name in ("hip", "knee", "ankle"))
_SHOULDERS, _ELBOWS, _WRISTS = (joint_pair(name) for name in ("shoulder", "elbow", "wrist"))
_HINGES = (*_KNEES, *_ANKLES, *_ELBOWS, *_WRISTS)
_LIMBS = (([*_HIPS, *_SHOULDERS], [*_KNEES, *_ELBOWS]), ([*_KNEES, *_ELBOWS], [*_ANKLES, *_WRISTS]))
"""Bones that are pointed, and where they end: thighs and upper arms, then shins and forearms."""

_SIGMA_M = {
    "pelvis": 0.045,
    "hip": 0.045,
    "spine": 0.045,
    "collar": 0.06,
    "neck": 0.03,
    "head": 0.03,
    "shoulder": 0.03,
    "knee": 0.015,
    "ankle": 0.015,
    "elbow": 0.015,
    "wrist": 0.015,
    "foot": 0.03,
    "jaw": 0.06,
    "eye": 0.03,
}
"""How far apart two models may put the joint of one body, metres."""


def _sigma(name: str) -> float:
    kind = name.removeprefix("left_").removeprefix("right_").rstrip("123")
    return _SIGMA_M.get(kind, 0.045)


_WEIGHT = np.array([1 / _sigma(name) ** 2 for name in JOINT_NAMES])


@dataclass(frozen=True)
class Fit:
    """Bodies of a model, float64.

    Attributes:
        world: (B, 55, 3, 3) rotation of each bone against the T-pose.
        betas: (B, K).
        transl: (B, 3) metres.
    """

    world: Array
    betas: Array
    transl: Array


def fit_joints(bones: Bones, joints: Array, world: Array | None, rounds: int = _ROUNDS) -> Fit:
    """Bodies whose joints lie where those of others do.

    Args:
        bones: of the model.
        joints: (B, 55, 3) metres, NaN where unknown; with known hips, shoulders or neck in every row.
        world: (B, 55, 3, 3) rotation of each bone against the T-pose, where the other model shares it: then only
            thighs, shins, upper arms and forearms are turned, by the shortest way, and nothing else. None to tell
            rotations from the joints.
        rounds: how often shape and rotations are told from each other.
    """
    known = numbers(joints)
    if world is None:
        known = _reached(known)
        joints = np.where(known[..., None], joints, np.nan)
    targets = np.where(known[..., None], joints, 0.0)
    weights = known * _WEIGHT
    betas = np.zeros((len(joints), len(bones.directions)))
    transl = np.zeros((len(joints), 3))
    bare = world is None
    turns = rotations_of(joints, bones.rest(betas)) if world is None else world
    for round_ in range(rounds):
        betas, transl = fit_shape(bones.by_shape(turns), bones.pose(turns, 0 * betas, 0 * transl), targets, weights)
        weights = known * _WEIGHT / _left_over(bones.pose(turns, betas, transl) - targets, known * _WEIGHT)
        if bare and not round_:
            turns = rotations_of(joints, bones.rest(betas))
        turns = _pointed(bones, turns, betas, transl, targets, known)
    return Fit(turns, betas, transl)


def _reached(known: Bools) -> Bools:
    """(B, 55) joints but those behind an unknown elbow, wrist, knee or ankle, to which no way is known."""
    reached = known.copy()
    for joint, parent in enumerate(PARENTS):
        if parent in _HINGES or parent >= 25:
            reached[:, joint] &= reached[:, parent]
    return reached


def _left_over(gap: Array, weights: Array) -> Array:
    """(B, 1) mean square of what is left over, in units of what two models may differ by; 1 at most."""
    square = (weights * (gap * gap).sum(-1)).sum(1) / np.maximum(3 * (weights > 0).sum(1), 1)
    share: Array = np.clip(square, _LEAST_LEFT_OVER**2, 1.0)[:, None]
    return share


def _pointed(bones: Bones, world: Array, betas: Array, transl: Array, targets: Array, known: Bools) -> Array:
    """Rotations with every limb pointed, from where it begins, at where the next joint ought to be."""
    turns = world.copy()
    offsets = bones.at(betas)
    start = bones.pose(turns, betas, transl)[:, _LIMBS[0][0]]
    for upper, lower in _LIMBS:
        bone = rotate(turns[:, upper], offsets[:, lower])
        want = np.where(known[:, lower, None], targets[:, lower] - start, bone)
        turns[:, upper] = rotation_between(bone, want) @ turns[:, upper]
        start = start + rotate(turns[:, upper], offsets[:, lower])
    return turns
