"""Fit a body model to the joints of another body, in closed form.

Similar to fitting SMPL by parts (Sarandi and Pons-Moll, smplfitter): rotations by Kabsch, shape and translation by
ridge regression, alternating. There are three differences. Hinges have larger weights than joints inside the trunk,
since their positions differ between models. The weights depend on the residual, so that a model is recovered from its
own joints. Limbs are aligned from their posed root, so that shape errors do not add up along the arm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physic_core.body.bones import BoneOffsets, fit_shape
from physic_core.body.convert.rotations_from_joints import finite_rows, rotations_from_joints
from physic_core.body.joints import FINGER_JOINTS, JOINT_NAMES, PARENTS, joint_pair
from physic_core.body.rotations import rotate, rotation_between

_Array = NDArray[np.float64]
_Bools = NDArray[np.bool_]

_ROUNDS = 3  # alternations between shape and rotations
_MIN_RESIDUAL = 0.02
"""Minimum of the residual relative to the difference of two models."""
_HIPS, _KNEES, _ANKLES = (joint_pair(name) for name in ("hip", "knee", "ankle"))
_SHOULDERS, _ELBOWS, _WRISTS = (joint_pair(name) for name in ("shoulder", "elbow", "wrist"))
_FINGERS = frozenset(np.ravel(FINGER_JOINTS).tolist())
_HINGES = (*_KNEES, *_ANKLES, *_ELBOWS, *_WRISTS)
_LIMBS = (([*_HIPS, *_SHOULDERS], [*_KNEES, *_ELBOWS]), ([*_KNEES, *_ELBOWS], [*_ANKLES, *_WRISTS]))
"""Joints of thighs and upper arms, then of shins and forearms, each with the joints at their ends."""

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
"""Standard deviation between the joints of two models on the same body, metres."""


def _sigma(name: str) -> float:
    """Return the standard deviation of a joint, metres."""
    kind = name.removeprefix("left_").removeprefix("right_").rstrip("123")
    return _SIGMA_M.get(kind, 0.045)


_WEIGHT = np.array([1 / _sigma(name) ** 2 for name in JOINT_NAMES])


@dataclass(frozen=True)
class BodyFit:
    """Rotations, betas and translations of fitted bodies, float64.

    Attributes:
        world: (B, 55, 3, 3) rotation of each bone against the T-pose.
        betas: (B, K).
        transl: (B, 3) metres.
    """

    world: _Array
    betas: _Array
    transl: _Array


def fit_joints(bones: BoneOffsets, joints: _Array, world: _Array | None) -> BodyFit:
    """Fit a body model to joints.

    Args:
        bones: of the model.
        joints: (B, 55, 3) metres, NaN where unknown; hips, and shoulders or neck, are known in every row.
        world: (B, 55, 3, 3) initial rotations relative to the T-pose, if the other model has the same one; only thighs,
            shins, upper arms and forearms are corrected. None to estimate rotations from the joints.
    """
    known = finite_rows(joints)
    if world is None:
        known = _exclude_unreachable(known)
        joints = np.where(known[..., None], joints, np.nan)
    targets = np.where(known[..., None], joints, 0.0)
    weights = known * _WEIGHT
    betas = np.zeros((len(joints), len(bones.directions)))
    transl = np.zeros((len(joints), 3))
    bare = world is None
    turns = rotations_from_joints(joints, bones.rest(betas)) if world is None else world
    for round_ in range(_ROUNDS):
        betas, transl = fit_shape(
            bones.shape_jacobian(turns), bones.pose(turns, 0 * betas, 0 * transl), targets, weights
        )
        weights = known * _WEIGHT / _residual(bones.pose(turns, betas, transl) - targets, known * _WEIGHT)
        if bare and not round_:
            turns = rotations_from_joints(joints, bones.rest(betas))
        turns = _align_limbs(bones, turns, betas, transl, targets, known)
    return BodyFit(turns, betas, transl)


def _exclude_unreachable(known: _Bools) -> _Bools:
    """Exclude joints (B, 55) beyond an unknown elbow, wrist, knee or ankle."""
    reached = known.copy()
    for joint, parent in enumerate(PARENTS):
        if parent in _HINGES or parent in _FINGERS:
            reached[:, joint] &= reached[:, parent]
    return reached


def _residual(gap: _Array, weights: _Array) -> _Array:
    """Return the mean squared residual (B, 1), relative to the difference of two models; at most 1."""
    square = (weights * (gap * gap).sum(-1)).sum(1) / np.maximum(3 * (weights > 0).sum(1), 1)
    share: _Array = np.clip(square, _MIN_RESIDUAL**2, 1.0)[:, None]
    return share


def _align_limbs(
    bones: BoneOffsets, world: _Array, betas: _Array, transl: _Array, targets: _Array, known: _Bools
) -> _Array:
    """Rotate each limb bone from its posed start to its target end."""
    turns = world.copy()
    offsets = bones.for_betas(betas)
    start = bones.pose(turns, betas, transl)[:, _LIMBS[0][0]]
    for upper, lower in _LIMBS:
        bone = rotate(turns[:, upper], offsets[:, lower])
        want = np.where(known[:, lower, None], targets[:, lower] - start, bone)
        turns[:, upper] = rotation_between(bone, want) @ turns[:, upper]
        start = start + rotate(turns[:, upper], offsets[:, lower])
    return turns
