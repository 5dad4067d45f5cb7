"""Attach separately estimated hands to the arms of bodies, by rotating wrists and forearms.

A hand network estimates the hand in the camera frame, without the forearm. A body network estimates
the arm, but the hand poorly. So the wrist is rotated along the shortest arc from the body's
estimate to the hand's, by a share that grows with the hand's confidence, within the range of a
wrist. The forearm takes most of the twist (pronation) about its own axis, so that elbow and wrist
do not move.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.bones import (
    BoneOffsets,
    rotations_from_parameters,
    rotations_from_parents,
    rotations_from_tpose,
)
from physic_core.body.joints import FINGER_JOINTS, joint_pair
from physic_core.geometry.rotations import rotmat_to_rotvec, rotvec_to_rotmat_numpy, slerp, unit

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import (
        BodyParameters,
        BoolArray,
        Float64Array,
        FloatArray,
        Hands,
        Int64Array,
    )

WRIST_LIMITS = np.array([1.6, 1.0, 1.5]) + 0.15
"""Largest rotation of a wrist from its place in the T-pose about x, y and z, radians: that of all
healthy poses, and a tolerance, since people differ.
"""

_SHOULDERS, _ELBOWS, _WRISTS = (joint_pair(name) for name in ("shoulder", "elbow", "wrist"))
_FOREARM_SHARE = 0.6
"""Share of the twist that the forearm takes."""
_MAX_FOREARM_TWIST = 1.4
"""Maximum twist of a forearm relative to the body's estimate, radians."""
_MIN_CONFIDENCE = 0.1
_FULL_CONFIDENCE = 0.5
"""Confidence up to which a hand has weight 0, and from which it has weight 1."""
_STEPS = 64
"""Number of steps along the arc at which the range is checked."""
_HANDS = np.array(FINGER_JOINTS).reshape(2, -1)


def attach_hands(parameters: BodyParameters, hands: Hands, model: BodyModel) -> BodyParameters:
    """Return bodies with the rotations of wrists, forearms and fingers from the hands.

    Args:
        parameters: of N bodies; NaN for people without an estimate.
        hands: of the same people, with ``wrists``.
        model: the body model that the parameters are for.
    """
    assert hands.wrists is not None
    share = _follow_shares(hands)
    rows = np.flatnonzero((share > 0).any(1) & np.isfinite(parameters.global_orient).all(1))
    if not len(rows):
        return parameters
    some = parameters[rows]
    world = rotations_from_tpose(rotations_from_parameters(some).double().numpy())
    has_hand = (share[rows] > 0)[..., None]
    wanted = rotvec_to_rotmat_numpy(np.where(has_hand, hands.wrists[rows], 0.0).astype(np.float64))
    wanted = np.where(has_hand[..., None], wanted, world[:, _WRISTS])
    axes = unit(BoneOffsets.of(model).for_betas(some.betas.astype(np.float64))[:, _WRISTS])
    elbows, wrists = _rotate_towards(
        world[:, _ELBOWS], world[:, _WRISTS], wanted, share[rows], axes
    )
    local = rotations_from_parents(world)
    local[:, _ELBOWS] = np.swapaxes(world[:, _SHOULDERS], -1, -2) @ elbows
    local[:, _WRISTS] = np.swapaxes(elbows, -1, -2) @ wrists
    fingers = rotvec_to_rotmat_numpy(
        np.where(has_hand[..., None], hands.rotvecs[rows], 0.0).astype(np.float64)
    )
    for side, joints in enumerate(_HANDS):
        local[:, joints] = slerp(local[:, joints], fingers[:, side], share[rows, side, None])
    return _set_arm_rotations(parameters, rows, local, has_hand[..., 0])


def _follow_shares(hands: Hands) -> Float64Array:
    """Return how far arms follow each hand (N, 2), from 0 to 1, smooth in the confidence."""
    confidence = np.asarray(hands.confidence, np.float64)
    ramp = np.clip((confidence - _MIN_CONFIDENCE) / (_FULL_CONFIDENCE - _MIN_CONFIDENCE), 0.0, 1.0)
    return ramp * ramp * (3 - 2 * ramp)


def wrist_turns_deg(parameters: BodyParameters, wrists: FloatArray) -> Float64Array:
    """Return by how many degrees (N, 2) wrists (N, 2, 3), in the camera's frame, are turned from
    those of bodies; NaN for people without an estimate.
    """
    rotations = rotations_from_tpose(rotations_from_parameters(parameters).double().numpy())
    given = rotvec_to_rotmat_numpy(np.asarray(wrists, np.float64))
    way = given @ np.swapaxes(rotations[:, _WRISTS], -1, -2)
    cosine = (np.trace(way, axis1=-2, axis2=-1) - 1) / 2
    turns: Float64Array = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return turns


def _rotate_towards(
    elbows: Float64Array,
    wrists: Float64Array,
    wanted: Float64Array,
    share: Float64Array,
    axes: Float64Array,
) -> tuple[Float64Array, Float64Array]:
    """Rotate forearms and hands (n, 2, 3, 3) by a ``share`` (n, 2) of the arc to the ``wanted``
    rotations.
    """
    difference = rotmat_to_rotvec(wanted @ np.swapaxes(wrists, -1, -2))
    start = rotmat_to_rotvec(np.swapaxes(elbows, -1, -2) @ wrists)
    # A wrist that is out of range at the start may stay there, and may return.
    low = np.minimum(-WRIST_LIMITS, start)
    high = np.maximum(WRIST_LIMITS, start)

    def at(step: Float64Array) -> tuple[Float64Array, Float64Array]:
        turn = difference * step[..., None]
        hand = rotvec_to_rotmat_numpy(turn) @ wrists
        forearm = elbows @ rotvec_to_rotmat_numpy(_pronation(elbows, turn, axes)[..., None] * axes)
        return forearm, hand

    steps = np.linspace(0.0, 1.0, _STEPS + 1)[:, None, None] * np.ones_like(share)
    forearm, hand = at(steps)
    bent = rotmat_to_rotvec(np.swapaxes(forearm, -1, -2) @ hand)
    beyond = ((bent < low - 1e-9) | (bent > high + 1e-9)).any(-1)
    first = np.where(beyond.any(0), beyond.argmax(0), _STEPS + 1)
    farthest = np.clip((first - 1) / _STEPS, 0.0, 1.0)
    return at(np.minimum(share, farthest))


def _pronation(elbows: Float64Array, turn: Float64Array, axes: Float64Array) -> Float64Array:
    """Return the twist (..., 2) of each forearm about its axis, radians, for hand rotations
    ``turn`` (..., 2, 3).

    The twist of ``turn`` about an axis a: twice the angle of (q_w, q . a) of its quaternion, with
    no jump on the way.
    """
    angle = np.linalg.norm(turn, axis=-1)
    own = (np.swapaxes(elbows, -1, -2) @ turn[..., None])[..., 0]
    along = (own * axes).sum(-1) / np.maximum(angle, 1e-12)
    twist = 2 * np.arctan2(along * np.sin(0.5 * angle), np.cos(0.5 * angle))
    clipped: Float64Array = np.clip(_FOREARM_SHARE * twist, -_MAX_FOREARM_TWIST, _MAX_FOREARM_TWIST)
    return clipped


def _set_arm_rotations(
    parameters: BodyParameters, rows: Int64Array, local: Float64Array, has_hand: BoolArray
) -> BodyParameters:
    """Replace elbows, wrists and fingers of ``rows`` where ``has_hand`` (n, 2); all other
    values stay identical.
    """
    changed = {
        name: getattr(parameters, name).copy()
        for name in ("body_pose", "left_hand_pose", "right_hand_pose")
    }
    for side, name in enumerate(("left_hand_pose", "right_hand_pose")):
        side_rotations = local[has_hand[:, side]]
        people = rows[has_hand[:, side]]
        changed[name][people] = rotmat_to_rotvec(side_rotations[:, _HANDS[side]]).reshape(
            len(people), 45
        )
        for joint in (_ELBOWS[side], _WRISTS[side]):
            columns = slice(3 * joint - 3, 3 * joint)
            changed["body_pose"][people, columns] = rotmat_to_rotvec(side_rotations[:, joint])
    return replace(parameters, **changed)
