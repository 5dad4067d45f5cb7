"""Start poses of one person with one or both feet 5 to 40 cm over the ground.

The conventions are those of ``solo_actions``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_testing.worlds.contact_fit import ContactTarget, PosePlan, PositionTarget
from physic_testing.worlds.pose_builder import PoseBuilder
from physic_testing.worlds.solids import Block

if TYPE_CHECKING:
    from collections.abc import Callable

    from physic_testing.worlds.solo_actions import MeasuredBody

__all__ = ["RAISED_ACTIONS"]

_SIDES = ("left", "right")
_CLEARANCE_M = (0.05, 0.40)  # between sole and ground


def _reach_down(person: MeasuredBody, flex: float, knee: float, point: float) -> float:
    """Return how far the lowest end of a foot is below the pelvis joint, for angles of ``PoseBuilder`` in degrees."""
    thigh, shin = np.radians(flex), np.radians(flex - knee)
    toes = max(0.0, 0.16 * person.stature / 1.7 * np.sin(np.radians(point) - shin))
    straight = person.leg - person.thigh - person.shank
    return float(straight + person.thigh * np.cos(thigh) + person.shank * np.cos(shin) + toes)


def _pose_arms(posture: PoseBuilder, rng: np.random.Generator, highest: float) -> None:
    """Pose both arms away from the body, between hanging and ``highest`` (the upward part of their direction)."""
    for side in _SIDES:
        up = rng.uniform(-1, highest)
        posture.arm(side, (rng.uniform(0.3, 1), up, rng.uniform(-0.3, 0.8)), (0.3, up + rng.uniform(0, 0.8), 0.8))
        posture.fingers(side, rng.uniform(5, 30), rng)


def jump(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person in the air above level ground, with stretched or tucked legs."""
    posture = PoseBuilder((rng.uniform(-8, 20), rng.uniform(-10, 10), 0)).trunk(rng.uniform(-5, 18), rng.uniform(-8, 8))
    posture.head(rng.uniform(-15, 10), rng.uniform(-20, 20))
    tucked, deepest = rng.uniform(0, 80), 0.0
    for side in _SIDES:
        flex = tucked + rng.uniform(-12, 12)
        knee, point = max(2.0, tucked * 1.15 + rng.uniform(-15, 25)), float(rng.uniform(0, 40))
        posture.leg(side, flex, knee, apart=rng.uniform(1, 10)).ankle(side, point=point)
        deepest = max(deepest, _reach_down(person, flex, knee, point))
    _pose_arms(posture, rng, 0.9)
    pelvis = (0.0, deepest + float(rng.uniform(*_CLEARANCE_M)), 0.0)
    return PosePlan("jump", posture.pose, person.betas, pelvis, drift=0.02)


def raise_foot(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person on one foot, with the other raised in front, behind or to the side."""
    stands = str(rng.choice(_SIDES))
    raised = "right" if stands == "left" else "left"
    kind = str(rng.choice(["front", "front", "behind", "side"]))
    posture = PoseBuilder((rng.uniform(-2, 12), 0, 0)).trunk(rng.uniform(-2, 10), rng.uniform(-8, 8))
    posture.head(rng.uniform(0, 12), rng.uniform(-25, 25))
    bend = rng.uniform(2, 18)
    posture.leg(stands, bend / 2, bend, apart=rng.uniform(-2, 2)).foot(stands, out=rng.uniform(2, 12))
    if kind == "front":
        flex = rng.uniform(35, 95)
        posture.leg(raised, flex, max(20.0, flex * rng.uniform(0.8, 1.3)), spread=rng.uniform(0, 10))
    elif kind == "behind":
        posture.leg(raised, rng.uniform(-18, 10), rng.uniform(55, 105), apart=rng.uniform(0, 4))
    else:
        posture.leg(raised, rng.uniform(0, 15), rng.uniform(5, 40), apart=rng.uniform(30, 45))
    posture.ankle(raised, point=rng.uniform(0, 30))
    _pose_arms(posture, rng, 0.3)
    pelvis = (0.0, person.leg - 0.01, 0.0)
    touches = (ContactTarget(f"{stands}_sole", 0.6),)
    return PosePlan("raise_foot", posture.pose, person.betas, pelvis, touches=touches)


def vault(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person over a box, on straight arms with both hands on it, and both feet in the air behind it."""
    size = person.stature / 1.7
    lean = rng.uniform(25, 55)
    posture = PoseBuilder((lean, 0, 0)).trunk(rng.uniform(5, 18), rng.uniform(-4, 4))
    posture.head(-lean * 0.6, rng.uniform(-15, 15))
    tucked, deepest = rng.uniform(20, 75), 0.0
    for side in _SIDES:
        flex = tucked + rng.uniform(-20, 20)
        knee, point = flex + rng.uniform(20, 60), float(rng.uniform(10, 35))
        posture.leg(side, flex, knee, apart=rng.uniform(2, 10)).ankle(side, point=point)
        deepest = max(deepest, _reach_down(person, flex, knee, point))
        posture.arm(side, (0.12, -1, 0.25), (-0.02, -1, 0.15), (0, -0.6, -1), wrist=60).fingers(side, 6, rng)
    bend = np.radians(lean + 10)
    pelvis_y = deepest + float(rng.uniform(*_CLEARANCE_M))
    height = pelvis_y + float(person.shoulder * np.cos(bend)) - 0.93 * person.arm - 0.04
    hands = float(person.shoulder * np.sin(bend)) + 0.16 * size
    depth, wide = float(rng.uniform(0.3, 0.7)), float(rng.uniform(0.5, 0.9))
    box = Block((0.0, height / 2, hands - 0.08 + depth / 2), (wide, height / 2, depth / 2), material="wood")
    touches = tuple(ContactTarget(f"{side}_palm", 0.3, blocks=(0,)) for side in _SIDES)
    reaches = tuple(
        PositionTarget(f"{side}_palm", (sign * 0.2 * size, height, hands), 0.05)
        for side, sign in zip(_SIDES, (1, -1), strict=True)
    )
    return PosePlan("vault", posture.pose, person.betas, (0.0, pelvis_y, -0.05), (box,), touches, reaches, drift=0.04)


def hold_bar(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person with both hands on a bar and feet in the air: arms bent under it, or straight over it."""
    over, size = rng.random() < 0.4, person.stature / 1.7
    lean = float(rng.uniform(8, 22) if over else rng.uniform(-12, 2))
    posture = PoseBuilder((lean, 0, 0)).trunk(rng.uniform(-4, 8), rng.uniform(-4, 4))
    posture.head(rng.uniform(-12, 8), rng.uniform(-15, 15))
    bend, deepest = rng.uniform(0, 80), 0.0
    for side in _SIDES:
        flex, knee, point = rng.uniform(-6, 10) + bend * 0.4, bend + rng.uniform(0, 8), float(rng.uniform(10, 40))
        posture.leg(side, flex, knee, apart=rng.uniform(0, 5)).ankle(side, point=point)
        deepest = max(deepest, _reach_down(person, flex, knee, point))
        if over:
            posture.arm(side, (0.12, -1, 0.12), (0.0, -1, 0.12), (0, -0.6, -1), wrist=40)
        else:
            up = rng.uniform(-0.6, 0.8)
            posture.arm(side, (0.35, up, 0.5), (-0.05, 1, 0.05), (0, 0.1, 1))
        posture.fingers(side, 50, rng)
    ahead = 0.24 * size if over else 0.18 * size
    above = -0.95 * person.arm if over else float(rng.uniform(0.0, 0.25)) * size  # of the hands over the shoulders
    hands = person.shoulder * np.cos(np.radians(lean)) + above
    pelvis_y = deepest + float(rng.uniform(*_CLEARANCE_M))
    height, radius, long = float(pelvis_y + hands), 0.018, float(rng.uniform(0.60, 0.75))
    bar = Block((0.0, height, ahead), (long, radius, radius), material="metal", rounding=radius)
    posts = tuple(
        Block((sign * (long - 0.02), height / 2, ahead), (0.03, height / 2, 0.03), material="metal") for sign in (1, -1)
    )
    touches = tuple(ContactTarget(f"{side}_palm", 0.25, blocks=(0,)) for side in _SIDES)
    reaches = tuple(
        PositionTarget(f"{side}_palm", (sign * 0.24 * size, height, ahead), 0.03)
        for side, sign in zip(_SIDES, (1, -1), strict=True)
    )
    return PosePlan(
        "hold_bar", posture.pose, person.betas, (0.0, pelvis_y, 0.0), (bar, *posts), touches, reaches, drift=0.05
    )


def sit_high(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person on a high wall or counter, with both feet in the air before it."""
    depth = float(rng.uniform(0.35, 0.6))
    posture = PoseBuilder((rng.uniform(-4, 8), 0, 0)).trunk(rng.uniform(4, 18), rng.uniform(-6, 6))
    posture.head(rng.uniform(0, 14), rng.uniform(-25, 25))
    height = person.shank + float(rng.uniform(*_CLEARANCE_M))
    wall = Block((0.0, height / 2, 0.0), (float(rng.uniform(0.5, 1.2)), height / 2, depth / 2), material="stone")
    front = depth / 2 + 0.095 * person.stature / 1.7 - 0.96 * person.thigh
    touches = [ContactTarget(f"{side}_thigh", 0.3, blocks=(0,)) for side in _SIDES]
    touches.append(ContactTarget("gluteus", 0.25, blocks=(0,)))
    for side in _SIDES:
        flex = 92 + rng.uniform(-2, 2)
        posture.leg(side, flex, flex - rng.uniform(-4, 18), spread=rng.uniform(3, 14))
        posture.ankle(side, point=rng.uniform(5, 30))
        posture.arm(side, (0.3, -1, 0.3), (rng.uniform(-0.15, 0.35), rng.uniform(-0.25, 0.5), 1), (-0.7, -0.2, 0.2))
        posture.fingers(side, rng.uniform(10, 30), rng)
    pelvis = (0.0, height + person.seat + 0.02, max(float(rng.uniform(-0.06, 0.0)), front))
    return PosePlan("sit_high", posture.pose, person.betas, pelvis, (wall,), tuple(touches), drift=0.05)


RAISED_ACTIONS: dict[str, Callable[[MeasuredBody, np.random.Generator], PosePlan]] = {
    "jump": jump,
    "raise_foot": raise_foot,
    "vault": vault,
    "hold_bar": hold_bar,
    "sit_high": sit_high,
}
"""Action name -> function that plans it for one person."""
