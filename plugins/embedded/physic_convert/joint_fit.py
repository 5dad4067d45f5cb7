"""Fit a body model to the joints of another body, in closed form.

Similar to fitting SMPL by parts (Sarandi and Pons-Moll, smplfitter): rotations by Kabsch, shape and
translation by ridge regression, alternating. There are three differences. Hinges have larger
weights than joints inside the trunk, since their positions differ between models. The weights
depend on the residual, so that a model is recovered from its own joints. Limbs are aligned from
their posed root, so that shape errors do not add up along the arm.

Without rotations, these follow from the joints, of which some may be unknown. Trunk and head follow
from directions between distant joints (hips, shoulders, spine), since the positions of joints
inside the trunk differ between models. Limbs follow from the direction of each bone and from the
hinge axis of knee or elbow; for a straight limb, from the foot or by the smallest rotation from the
trunk.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import (
    FINGER_JOINTS,
    JOINT_INDEX,
    JOINT_NAMES,
    PARENTS,
    BoneOffsets,
    fit_shape,
    joint_pair,
)
from physic_core.geometry import (
    cross,
    frame_from_axes,
    nearest_rotation,
    rotate,
    rotation_between,
    rotvec_to_rotmat_numpy,
    slerp,
    swing_twist,
    unit,
)

if TYPE_CHECKING:
    from physic_core.types import BoolArray, Float64Array, FloatArray


_HIPS, _KNEES, _ANKLES, _FEET = (joint_pair(name) for name in ("hip", "knee", "ankle", "foot"))
_COLLARS, _SHOULDERS, _ELBOWS, _WRISTS = (
    joint_pair(name) for name in ("collar", "shoulder", "elbow", "wrist")
)
_EYES = joint_pair("eye")
_PELVIS, _SPINE1, _SPINE2, _SPINE3 = (
    JOINT_INDEX[name] for name in ("pelvis", "spine1", "spine2", "spine3")
)
_UPPER = [*_HIPS, *_SHOULDERS]
_LOWER = [*_KNEES, *_ELBOWS]
_END = [*_ANKLES, *_WRISTS]
"""Hips and shoulders, knees and elbows, ankles and wrists; left before right."""
_HINGES = np.array([[1.0, 0, 0], [1.0, 0, 0], [0, -1.0, 0], [0, 1.0, 0]])
"""Hinge axis of each knee and elbow in the T-pose."""
_FINGERS = np.array(FINGER_JOINTS)
_MIN_BEND = 0.15
_FULL_BEND = 0.4
"""Sine of the hinge angle: below the first value the axis is unreliable, from the second it has
full weight.
"""
_BY_FOOT = 1.0
_BY_TRUNK = 0.3
"""Weights of the foot and of the trunk for the hinge axis of a straight limb."""


def has_torso_joints(known: BoolArray) -> BoolArray:
    """Return which bodies (B,) have both hips, and both shoulders or the neck, among the known
    joints (B, 55).
    """
    return known[:, _HIPS].all(1) & (known[:, _SHOULDERS].all(1) | known[:, JOINT_INDEX["neck"]])


def finite_rows(joints: FloatArray) -> BoolArray:
    """Return whether each vector (..., 3) is finite: (...) bool."""
    return np.asarray(np.isfinite(joints).all(-1), bool)


def rotations_from_joints(joints: Float64Array, rest: Float64Array) -> Float64Array:
    """Estimate the rotation of every bone relative to the T-pose.

    Args:
        joints: (B, 55, 3) metres, NaN where unknown; of bodies with :func:`has_torso_joints`
            joints.
        rest: (B, 55, 3) joints of the same body in the T-pose.

    Returns:
        (B, 55, 3, 3); unknown bones rotate with their parents.
    """
    known = finite_rows(joints)
    both = np.stack([np.where(known[..., None], joints, 0.0), rest])  # posed, and in the T-pose
    joints = both[0]
    world = np.broadcast_to(np.eye(3), (*joints.shape, 3)).copy()
    _set_trunk(world, both, known)
    neck = JOINT_INDEX["neck"]
    for shoulder in _SHOULDERS:
        # Place an unknown shoulder as in the T-pose relative to the chest.
        guess = joints[:, neck] + rotate(world[:, _SPINE3], rest[:, shoulder] - rest[:, neck])
        fill = ~known[:, shoulder] & known[:, neck]
        joints[:, shoulder] = np.where(fill[:, None], guess, joints[:, shoulder])
        known[:, shoulder] |= fill
    _set_head(world, both, known)
    _set_limbs(world, both, known)
    _set_hands(world, both, known)
    return world


def _set_trunk(world: Float64Array, both: Float64Array, known: BoolArray) -> None:
    """Set the rotations of pelvis, spine and collars."""
    hips, top = (both[:, :, pair].mean(2) for pair in (_HIPS, _SHOULDERS))
    top = np.where(known[:, JOINT_INDEX["neck"], None], both[:, :, JOINT_INDEX["neck"]], top)
    middle = top
    for joint in (_SPINE3, _SPINE2):
        middle = np.where(known[:, joint, None], both[:, :, joint], middle)
    low = _align(_left_minus_right(both, _HIPS), middle - hips)
    # The upper trunk starts at the middle of the spine if that is known.
    base = np.where((middle == top)[0].all(-1, keepdims=True), hips, middle)
    wide = known[:, _SHOULDERS].all(-1, keepdims=True)
    across = _left_minus_right(both, _SHOULDERS)
    across[0] = np.where(wide, across[0], rotate(low, across[1]))
    high = _align(across, top - base)
    world[:, _PELVIS] = low
    world[:, _SPINE3] = high
    world[:, _SPINE1] = slerp(low, high, 1 / 3)
    world[:, _SPINE2] = slerp(low, high, 2 / 3)
    _set_collars(world, both, known)


def _set_collars(world: Float64Array, both: Float64Array, known: BoolArray) -> None:
    """Set the rotations of collars to the elevation and protraction of the shoulders: their
    distance depends on shape.
    """
    joints, rest = both
    chest = world[:, _SPINE3]
    wide = np.asarray(known[:, _SHOULDERS].all(-1))[:, None, None]
    for collar, shoulder in zip(_COLLARS, _SHOULDERS, strict=True):
        middle = joints[:, _SHOULDERS].mean(1) - rotate(
            chest, rest[:, _SHOULDERS].mean(1) - rest[:, collar]
        )
        turn = rotation_between(
            rotate(chest, rest[:, shoulder] - rest[:, collar]), joints[:, shoulder] - middle
        )
        world[:, collar] = np.where(wide, turn @ chest, chest)


def _set_head(world: Float64Array, both: Float64Array, known: BoolArray) -> None:
    """Set the rotations of neck, head, jaw and eyes."""
    joints, rest = both
    neck = JOINT_INDEX["neck"]
    head = JOINT_INDEX["head"]
    chest = world[:, _SPINE3]
    neck_rotation = rotation_between(
        rotate(chest, rest[:, head] - rest[:, neck]), joints[:, head] - joints[:, neck]
    )
    is_known = (known[:, neck] & known[:, head])[:, None, None]
    world[:, neck] = np.where(is_known, neck_rotation @ chest, chest)
    looks = np.logical_and.reduce(known[:, [head, *_EYES]], axis=-1)[:, None, None]
    face = _align(_left_minus_right(both, _EYES), both[:, :, _EYES].mean(2) - both[:, :, head])
    world[:, head] = np.where(looks, face, world[:, neck])
    # The neck takes half of the twist between chest and head.
    bone = rest[:, head] - rest[:, neck]
    _, angle = swing_twist(np.swapaxes(world[:, neck], -1, -2) @ world[:, head], bone)
    world[:, neck] = world[:, neck] @ rotvec_to_rotmat_numpy(
        0.5 * np.where(looks[..., 0], angle[:, None], 0.0) * unit(bone)
    )
    world[:, [JOINT_INDEX["jaw"], *_EYES]] = world[:, [head]]


def _set_limbs(world: Float64Array, both: Float64Array, known: BoolArray) -> None:
    """Set the rotations of arms, legs and feet, from those of pelvis and collars."""
    joints, rest = both
    parent_rotations = world[:, [_PELVIS, _PELVIS, *_COLLARS]]
    first, second = (rest[:, b] - rest[:, a] for a, b in ((_UPPER, _LOWER), (_LOWER, _END)))
    upper_known = known[:, _UPPER] & known[:, _LOWER]
    lower_known = known[:, _LOWER] & known[:, _END]
    upper = np.where(
        upper_known[..., None],
        joints[:, _LOWER] - joints[:, _UPPER],
        rotate(parent_rotations, first),
    )
    default = rotation_between(rotate(parent_rotations, first), upper)
    trunk = rotate(default @ parent_rotations, _HINGES)
    lower = np.where(
        lower_known[..., None],
        joints[:, _END] - joints[:, _LOWER],
        rotate(default @ parent_rotations, second),
    )
    feet = joints[:, _FEET] - joints[:, _ANKLES]
    feet_known = (known[:, _FEET] & known[:, _ANKLES])[..., None]
    hint = _BY_TRUNK * trunk
    # Feet point forward: across them is the axis of the knee.
    hint[:, :2] += _BY_FOOT * np.where(feet_known, unit(cross(feet, lower[:, :2])), 0.0)
    axis = _hinge_axes(upper, lower, hint)
    for bones, at_rest, is_known, rows in (
        (upper, first, upper_known, _UPPER),
        (lower, second, lower_known, _LOWER),
    ):
        turn = _turns_of_bones(bones, at_rest, axis)
        parent = world[:, [PARENTS[row] for row in rows]]
        world[:, rows] = np.where(is_known[..., None, None], turn, parent)
    _set_feet(world, rest[:, _FEET] - rest[:, _ANKLES], feet, feet_known)


def _set_feet(
    world: Float64Array, at_rest: Float64Array, feet: Float64Array, known: BoolArray
) -> None:
    """Set the rotations of ankles and feet, from those of the knees."""
    shin = world[:, _KNEES]
    tread = rotation_between(rotate(shin, at_rest), feet) @ shin
    world[:, _ANKLES] = np.where(known[..., None], tread, shin)
    world[:, _FEET] = world[:, _ANKLES]


def _turns_of_bones(bones: Float64Array, at_rest: Float64Array, axis: Float64Array) -> Float64Array:
    """Return the rotations that bring bones from rest to where they are, and hinges to an axis."""
    frame = frame_from_axes(at_rest, np.broadcast_to(_HINGES, at_rest.shape))
    return frame_from_axes(bones, axis) @ np.swapaxes(frame, -1, -2)


def _hinge_axes(upper: Float64Array, lower: Float64Array, hint: Float64Array) -> Float64Array:
    """Return the axis (B, 4, 3) about which each limb bends, from its two bones; near to a hint if
    the limb is straight.
    """
    bend = cross(unit(upper), unit(lower))
    sine = np.sqrt((bend * bend).sum(-1, keepdims=True))
    weight = np.clip((sine - _MIN_BEND) / (_FULL_BEND - _MIN_BEND), 0.0, 1.0)
    axis: Float64Array = weight * unit(bend) + (1 - weight) * unit(hint)
    return axis


def _set_hands(world: Float64Array, both: Float64Array, known: BoolArray) -> None:
    """Set the rotations of forearm twist, wrists and fingers."""
    joints, rest = both
    arms = world[:, _ELBOWS]
    bases = _FINGERS[:, :, 0]
    is_known = known[:, bases] & known[:, _WRISTS][..., None]
    stick = joints[:, bases] - joints[:, _WRISTS][:, :, None]
    rest_stick = rest[:, bases] - rest[:, _WRISTS][:, :, None]
    moments = np.einsum("bsf,bsfi,bsfk->bsik", is_known.astype(float), stick, rest_stick)
    # Two fingers determine a frame; the small weight of the forearm removes a remaining ambiguity.
    enough_fingers = (is_known.sum(-1) >= 2)[..., None, None]
    hand = nearest_rotation(
        np.where(enough_fingers, moments, np.eye(3)) + np.where(enough_fingers, 1e-6, 0.0) * arms
    )
    hand = np.where(enough_fingers, hand, arms)
    # The forearm takes half of the twist of the hand.
    forearm = rest[:, _WRISTS] - rest[:, _ELBOWS]
    _, angle = swing_twist(np.swapaxes(arms, -1, -2) @ hand, forearm)
    world[:, _ELBOWS] = arms @ rotvec_to_rotmat_numpy(0.5 * angle[..., None] * unit(forearm))
    world[:, _WRISTS] = hand
    parent_rotations = np.repeat(hand[:, :, None], 5, axis=2)
    for joint in range(3):
        if joint < 2:
            bone_starts = _FINGERS[..., joint]
            bone_ends = _FINGERS[..., joint + 1]
            bone_direction = rotate(parent_rotations, rest[:, bone_ends] - rest[:, bone_starts])
            both_known = (known[:, bone_starts] & known[:, bone_ends])[..., None]
            parent_rotations = (
                rotation_between(
                    bone_direction,
                    np.where(
                        both_known, joints[:, bone_ends] - joints[:, bone_starts], bone_direction
                    ),
                )
                @ parent_rotations
            )
        world[:, _FINGERS[..., joint]] = parent_rotations


def _align(*sticks: Float64Array) -> Float64Array:
    """Return the rotation (B, 3, 3) that best aligns directions (2, B, 3): posed, and in the
    T-pose.
    """
    moments = sum(unit(now)[:, :, None] * unit(rest)[:, None, :] for now, rest in sticks)
    return nearest_rotation(np.asarray(moments))


def _left_minus_right(both: Float64Array, pair: list[int]) -> Float64Array:
    """Return the vectors (2, B, 3) from the right to the left joint of a pair."""
    left, right = pair
    return both[:, :, left] - both[:, :, right]


@dataclass(frozen=True)
class BodyFit:
    """Rotations, betas and translations of fitted bodies, float64.

    Attributes:
        world: (B, 55, 3, 3) rotation of each bone against the T-pose.
        betas: (B, K).
        transl: (B, 3) metres.
    """

    world: Float64Array
    betas: Float64Array
    transl: Float64Array


_ROUNDS = 3  # alternations between shape and rotations
_BEFORE_ENDS = {*_KNEES, *_ANKLES, *_ELBOWS, *_WRISTS, *_FINGERS.ravel().tolist()}
"""Joints that must be known for those beyond them to count."""

_SIGMA_M = {
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

_OTHER_SIGMA_M = 0.045  # pelvis, hips, spine and fingers
_KINDS = [name.removeprefix("left_").removeprefix("right_").rstrip("123") for name in JOINT_NAMES]
_WEIGHT = np.array([1 / _SIGMA_M.get(kind, _OTHER_SIGMA_M) ** 2 for kind in _KINDS])


def fit_joints(bones: BoneOffsets, joints: Float64Array, world: Float64Array | None) -> BodyFit:
    """Fit a body model to joints.

    Args:
        bones: of the model.
        joints: (B, 55, 3) metres, NaN where unknown; hips, and shoulders or neck, are known in
            every row.
        world: (B, 55, 3, 3) initial rotations relative to the T-pose, if the other model has the
            same one; only thighs, shins, upper arms and forearms are corrected. None to estimate
            rotations from the joints.
    """
    known = finite_rows(joints)
    betas = np.zeros((len(joints), len(bones.directions)))
    transl = np.zeros((len(joints), 3))
    if world is None:
        for joint, parent in enumerate(PARENTS):
            if parent in _BEFORE_ENDS:
                known[:, joint] &= known[:, parent]
        joints = np.where(known[..., None], joints, np.nan)
        turns = rotations_from_joints(joints, bones.rest(betas))
    else:
        turns = world
    targets = np.where(known[..., None], joints, 0.0)
    weights = sure = known * _WEIGHT
    for round_ in range(_ROUNDS):
        betas, transl = fit_shape(
            bones.shape_jacobian(turns), bones.pose(turns, 0 * betas, 0 * transl), targets, weights
        )
        weights = sure / _residual(bones.pose(turns, betas, transl) - targets, sure)
        if world is None and not round_:
            turns = rotations_from_joints(joints, bones.rest(betas))
        turns = _align_limbs(bones, turns, betas, transl, targets, known)
    return BodyFit(turns, betas, transl)


_MIN_RESIDUAL = 0.02
"""Minimum of the residual relative to the difference of two models."""


def _residual(gap: Float64Array, weights: Float64Array) -> Float64Array:
    """Return the mean squared residual (B, 1), relative to the difference of two models; at most
    1.
    """
    square = (weights * (gap * gap).sum(-1)).sum(1) / np.maximum(3 * (weights > 0).sum(1), 1)
    share: Float64Array = np.clip(square, _MIN_RESIDUAL**2, 1.0)[:, None]
    return share


def _align_limbs(
    bones: BoneOffsets,
    world: Float64Array,
    betas: Float64Array,
    transl: Float64Array,
    targets: Float64Array,
    known: BoolArray,
) -> Float64Array:
    """Rotate each limb bone from its posed start to its target end."""
    turns = world.copy()
    offsets = bones.for_betas(betas)
    start = bones.pose(turns, betas, transl)[:, _UPPER]
    for upper, lower in ((_UPPER, _LOWER), (_LOWER, _END)):
        bone = rotate(turns[:, upper], offsets[:, lower])
        want = np.where(known[:, lower, None], targets[:, lower] - start, bone)
        turns[:, upper] = rotation_between(bone, want) @ turns[:, upper]
        start = start + rotate(turns[:, upper], offsets[:, lower])
    return turns
