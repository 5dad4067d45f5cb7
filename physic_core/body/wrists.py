"""Puts hands that were estimated alone onto the arms of bodies: the whole hand turned, not only its fingers.

A hand network says how the hand lies in the camera's frame, and knows no forearm; a body network says how the arm lies,
and sees little of the hand. So the wrist goes the shortest way from what the body says to what the hand says, as far as
the hand is sure and as far as a wrist goes; of the turn about the forearm, the forearm does most, as pronation is.
The forearm turns about its own axis, so that elbow and wrist stay where they are to the last digit.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from physic_core.body.bones import Bones, local_from_world, world_from_local
from physic_core.body.joints import joint_pair
from physic_core.body.parameters import parameters_from_rotations, rotations_from_parameters
from physic_core.body.rotations import exp, log, slerp, unit

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import BodyParameters, Hands

__all__ = ["WRIST_RANGE", "Range", "stitch", "trust"]

Array = NDArray[np.float64]
Range = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
"""Lowest and highest turn of the left wrist about x, y and z, radians."""

WRIST_RANGE: Range = ((-1.6, 1.6), (-1.0, 1.0), (-1.5, 1.5))
"""How far a left wrist turns from the T-pose; no healthy pose lies beyond."""

_SHOULDERS, _ELBOWS, _WRISTS = (joint_pair(name) for name in ("shoulder", "elbow", "wrist"))
_FOREARM = 0.6
"""Share of a turn about the forearm that is done by the forearm."""
_MOST_FOREARM = 1.4
"""Radians that a forearm turns beyond what the body says."""
_DOUBTED, _TRUSTED = 0.1, 0.5
"""Confidence up to which a hand counts for nothing, and from which it counts for everything."""
_SLACK = 0.15
"""Radians by which a wrist may go beyond its range: ranges of people differ."""
_STEPS = 64
"""Into how many steps the way is cut to see where it leaves the range."""
_HANDS = [[*range(25, 40)], [*range(40, 55)]]


def trust(confidence: NDArray[np.floating]) -> Array:
    """Confidence -> share in [0, 1] of the way from what the body says to what the hand says; smooth, and 0 at 0."""
    x = np.clip((np.asarray(confidence, np.float64) - _DOUBTED) / (_TRUSTED - _DOUBTED), 0.0, 1.0)
    return x * x * (3 - 2 * x)


def stitch(parameters: BodyParameters, hands: Hands, model: BodyModel, wrist_range: Range) -> BodyParameters:
    """Bodies with the hands on their arms.

    Args:
        parameters: of N bodies, those of whom nothing is known NaN.
        hands: of the same people, with ``wrists``.
        model: the body model that the parameters are for.
        wrist_range: how far a left wrist turns against its forearm; the right one is its mirror image.
    """
    assert hands.wrists is not None
    share = trust(hands.confidence)
    rows = np.flatnonzero((share > 0).any(1) & np.isfinite(parameters.global_orient).all(1))
    if not len(rows):
        return parameters
    some = parameters[rows]
    world = world_from_local(rotations_from_parameters(some).double().numpy())
    told = (share[rows] > 0)[..., None]
    wanted = exp(np.where(told, hands.wrists[rows], 0.0).astype(np.float64))
    wanted = np.where(told[..., None], wanted, world[:, _WRISTS])
    axes = unit(Bones.of(model).at(some.betas.astype(np.float64))[:, _WRISTS])
    elbows, wrists = _turned(world[:, _ELBOWS], world[:, _WRISTS], wanted, share[rows], axes, wrist_range)
    local = local_from_world(world)
    local[:, _ELBOWS] = np.swapaxes(world[:, _SHOULDERS], -1, -2) @ elbows
    local[:, _WRISTS] = np.swapaxes(elbows, -1, -2) @ wrists
    fingers = exp(np.where(told[..., None], hands.rotvecs[rows], 0.0).astype(np.float64))
    for side, joints in enumerate(_HANDS):
        local[:, joints] = slerp(local[:, joints], fingers[:, side], share[rows, side, None])
    return _with_arms(parameters, rows, local, told[..., 0])


def _turned(
    elbows: Array, wrists: Array, wanted: Array, share: Array, axes: Array, wrist_range: Range
) -> tuple[Array, Array]:
    """World rotations (n, 2, 3, 3) of forearms and hands, a ``share`` (n, 2) of the way to what is ``wanted``."""
    way = log(wanted @ np.swapaxes(wrists, -1, -2))
    low, high = _limits(wrist_range)
    start = log(np.swapaxes(elbows, -1, -2) @ wrists)
    # Whoever begins outside may stay there, and everybody comes back in.
    low, high = np.minimum(low, start), np.maximum(high, start)

    def at(step: Array) -> tuple[Array, Array]:
        turn = way * step[..., None]
        hand = exp(turn) @ wrists
        forearm = elbows @ exp(_pronation(elbows, turn, axes)[..., None] * axes)
        return forearm, hand

    steps = np.linspace(0.0, 1.0, _STEPS + 1)[:, None, None] * np.ones_like(share)
    forearm, hand = at(steps)
    bent = log(np.swapaxes(forearm, -1, -2) @ hand)
    beyond = ((bent < low - 1e-9) | (bent > high + 1e-9)).any(-1)
    first = np.where(beyond.any(0), beyond.argmax(0), _STEPS + 1)
    farthest = np.clip((first - 1) / _STEPS, 0.0, 1.0)
    return at(np.minimum(share, farthest))


def _pronation(elbows: Array, turn: Array, axes: Array) -> Array:
    """(..., 2) radians that each forearm turns about its axis, of the hand's ``turn`` (..., 2, 3).

    The twist of ``turn`` about an axis a: twice the angle of (q_w, q . a) of its quaternion, with no jump on the way.
    """
    angle = np.linalg.norm(turn, axis=-1)
    own = (np.swapaxes(elbows, -1, -2) @ turn[..., None])[..., 0]
    along = (own * axes).sum(-1) / np.maximum(angle, 1e-12)
    twist = 2 * np.arctan2(along * np.sin(0.5 * angle), np.cos(0.5 * angle))
    clipped: Array = np.clip(_FOREARM * twist, -_MOST_FOREARM, _MOST_FOREARM)
    return clipped


def _limits(wrist_range: Range) -> tuple[Array, Array]:
    """(2, 3) lowest and highest, left and right."""
    low, high = (np.array([bounds[k] for bounds in wrist_range]) for k in (0, 1))
    mirrored = (np.array([low[0], -high[1], -high[2]]), np.array([high[0], -low[1], -low[2]]))
    return np.stack([low, mirrored[0]]) - _SLACK, np.stack([high, mirrored[1]]) + _SLACK


def _with_arms(
    parameters: BodyParameters, rows: NDArray[np.int64], local: Array, told: NDArray[np.bool_]
) -> BodyParameters:
    """The parameters with elbows, wrists and fingers of ``rows`` where ``told`` (n, 2); all else bit for bit."""
    some = parameters[rows]
    given = (torch.from_numpy(np.array(value)) for value in (some.betas, some.expression, some.transl))
    betas, expression, transl = given
    turned = parameters_from_rotations(torch.from_numpy(local), betas, expression, transl)
    changed = {name: getattr(parameters, name).copy() for name in ("body_pose", "left_hand_pose", "right_hand_pose")}
    for side, name in enumerate(("left_hand_pose", "right_hand_pose")):
        people = rows[told[:, side]]
        changed[name][people] = getattr(turned, name)[told[:, side]]
        for joint in (_ELBOWS[side], _WRISTS[side]):
            columns = slice(3 * joint - 3, 3 * joint)
            changed["body_pose"][people, columns] = turned.body_pose[told[:, side], columns]
    return replace(parameters, **changed)
