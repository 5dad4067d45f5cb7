"""Start poses of one person who touches the own body, a hidden or soft support, or a small object.

The conventions are those of ``solo_actions``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.worlds import furniture, solo_actions
from physic_testing.worlds.contact_fit import ContactTarget, PosePlan, PositionTarget
from physic_testing.worlds.pose_builder import PoseBuilder
from physic_testing.worlds.solids import Block

if TYPE_CHECKING:
    from collections.abc import Callable

    from physic_testing.worlds.solo_actions import MeasuredBody

__all__ = ["CONTACT_ACTIONS"]

_SIDES = ("left", "right")
_SOLES = tuple(ContactTarget(f"{side}_sole", 0.6) for side in _SIDES)


def _other(side: str) -> str:
    return "right" if side == "left" else "left"


def _standing(
    person: MeasuredBody, rng: np.random.Generator, action: str, lean: float = 0.0
) -> tuple[PoseBuilder, PosePlan]:
    """Plan a person who stands on both feet, with arms still to be posed."""
    plan = replace(solo_actions.stand(person, rng), action=action, touches=_SOLES)
    posture = PoseBuilder((lean + rng.uniform(-1, 3), 0, 0)).trunk(rng.uniform(-1, 5), rng.uniform(-5, 5))
    posture.head(rng.uniform(0, 10), rng.uniform(-25, 25), rng.uniform(-5, 5))
    for side in _SIDES:
        posture.leg(side, lean + rng.uniform(-2, 3), rng.uniform(0, 5), apart=rng.uniform(3, 7))
        posture.foot(side, out=rng.uniform(4, 14))
    return posture, replace(plan, pose=posture.pose)


def _finished(plan: PosePlan, posture: PoseBuilder, *touches: ContactTarget) -> PosePlan:
    """Return the plan with the pose of the builder and more contact targets."""
    return replace(plan, pose=posture.pose, touches=(*plan.touches, *touches))


def _seated(person: MeasuredBody, rng: np.random.Generator, action: str) -> tuple[PoseBuilder, PosePlan]:
    """Plan a person who sits upright on a chair, with arms still to be posed."""
    plan = solo_actions.sit_on_chair(person, rng)
    seat = plan.blocks[4]
    height = seat.centre[1] + seat.half[1]
    posture = PoseBuilder((rng.uniform(-3, 5), 0, 0)).trunk(rng.uniform(4, 12), rng.uniform(-4, 4))
    touches = solo_actions.seated_legs(posture, person, rng, height)
    posture.head(rng.uniform(2, 12), rng.uniform(-20, 20), rng.uniform(-5, 5))
    return posture, replace(plan, action=action, pose=posture.pose, touches=touches)


# ---- own body ------------------------------------------------------------------------------------------------------


def cross_arms(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a standing person with crossed arms, each hand on the other arm."""
    posture, plan = _standing(person, rng, "cross_arms")
    over = str(rng.choice(_SIDES))
    for side in _SIDES:
        up, ahead = (0.30, 0.44) if side == over else (-0.04, 0.26)
        posture.arm(side, (0.10, -1, 0.34), (-0.95, up, ahead), (-0.2, -0.2, -1)).fingers(side, 10, rng)
    palms = (ContactTarget(f"{side}_palm", 0.2, on="self", target=f"{_other(side)}_lower_arm") for side in _SIDES)
    return _finished(plan, posture, *palms)


def hands_on_hips(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a standing person with both hands on the hips."""
    posture, plan = _standing(person, rng, "hands_on_hips")
    for side in _SIDES:
        posture.arm(side, (0.75, -0.8, -0.25), (-0.62, -0.62, 0.30), (-0.8, -0.6, 0)).fingers(side, 14, rng)
    palms = (ContactTarget(f"{side}_palm", 0.25, on="self", target=f"{side}_waist") for side in _SIDES)
    return _finished(plan, posture, *palms)


def hands_on_knees(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person bent forward with straight arms, both hands on the thighs above the knees."""
    _, plan = _standing(person, rng, "hands_on_knees")
    lean, bend = rng.uniform(38, 48), rng.uniform(24, 34)
    posture = PoseBuilder((lean, 0, 0)).trunk(rng.uniform(16, 24), rng.uniform(-3, 3))
    posture.head(-rng.uniform(20, 40), rng.uniform(-15, 15))
    for side in _SIDES:
        posture.leg(side, bend - 4, bend, apart=rng.uniform(5, 9)).foot(side, out=rng.uniform(6, 14))
        posture.arm(side, (0.10, -1, 0.05), (-0.02, -1, 0.1), (-0.1, -0.5, -1), wrist=20).fingers(side, 12, rng)
    palms = (ContactTarget(f"{side}_palm", 0.25, on="self", target=f"{side}_lap") for side in _SIDES)
    drop = (person.thigh + person.shank) * (1 - float(np.cos(np.radians(bend / 2))))
    plan = replace(plan, pelvis=(0.0, person.leg - drop, -0.10))
    return _finished(plan, posture, *palms)


def clasp_hands(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a standing or sitting person with palms together before the belly or chest."""
    make = _seated if rng.random() < 0.4 else _standing
    posture, plan = make(person, rng, "clasp_hands")
    up = rng.uniform(0.15, 0.7)
    for side in _SIDES:
        posture.arm(side, (0.26, -1, 0.30), (-0.62, up, 0.75), (-1, 0, 0.1)).fingers(side, 3, rng)
    return _finished(plan, posture, ContactTarget("left_palm", 0.35, on="self", target="right_palm"))


def chin_on_hand(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person at a table with one elbow on its top and the chin on that hand."""
    plan = replace(solo_actions.sit_behind_table(person, rng), action="chin_on_hand")
    seat, top = plan.blocks[4], next(block for block in plan.blocks[7:] if block.half[1] < 0.03)
    index, height = plan.blocks.index(top), top.centre[1] + top.half[1]
    edge = top.centre[2] - top.half[2]
    side = str(rng.choice(_SIDES))
    sign = 1.0 if side == "left" else -1.0
    size = person.stature / 1.7
    posture = PoseBuilder((rng.uniform(2, 8), 0, 0)).trunk(rng.uniform(12, 18), 0, rng.uniform(-2, 2))
    touches = solo_actions.seated_legs(posture, person, rng, seat.centre[1] + seat.half[1])
    posture.head(rng.uniform(4, 12), sign * rng.uniform(-4, 4), sign * rng.uniform(0, 6))
    posture.arm(side, (0.12, -0.62, 0.8), (-0.5, 1, -0.25), (-0.3, 0.3, -1), wrist=30).fingers(side, 40, rng)
    away = _other(side)
    posture.arm(away, (0.25, -1, 0.45), (-0.4, 0.2, 1), (0, -1, 0)).fingers(away, 8, rng)
    touches += (
        ContactTarget(f"{side}_elbow", 0.06, blocks=(index,)),
        ContactTarget(f"{side}_palm", 0.12, on="self", target="chin"),
        ContactTarget(f"{away}_palm", 0.2, blocks=(index,)),
    )
    reaches = (PositionTarget(f"{away}_palm", (-sign * 0.04, height, float(edge) + 0.16 * size), 0.08),)
    return replace(plan, pose=posture.pose, touches=touches, reaches=reaches)


# ---- supports ------------------------------------------------------------------------------------------------------


def lean_on_post(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person who leans back on a post, which the own body hides from the front."""
    lean = float(rng.uniform(8, 12))
    posture, plan = _standing(person, rng, "lean_on_post", lean=-lean)
    for side in _SIDES:
        posture.leg(side, lean + rng.uniform(2, 6), rng.uniform(2, 8), apart=rng.uniform(1, 4)).foot(side, out=6)
        posture.arm(side, (0.22, -1, 0.25), (-0.30, -0.8, 0.8), (-1, -0.2, 0)).fingers(side, 15, rng)
    posture.head(lean, rng.uniform(-15, 15))
    half, high = float(rng.uniform(0.07, 0.10)), person.leg + person.shoulder - float(rng.uniform(0.0, 0.1))
    post = Block(
        (0.0, high / 2, -person.behind - 0.02 - half), (half, high / 2, half), material="wood", surface="object"
    )
    back = (ContactTarget("upper_back", 0.08, blocks=(0,)), ContactTarget("gluteus", 0.06, blocks=(0,)))
    plan = replace(plan, pelvis=(0.0, person.leg - 0.02, 0.0), blocks=(post,), balanced=False)
    return replace(_finished(plan, posture, *back), azimuth=(-12.0, 12.0))


def sit_on_pedestal(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person on a narrow pedestal, which legs and hips hide from the front."""
    height = max(0.28, min(float(rng.uniform(0.40, 0.46)), solo_actions.knee_hollow_height(person)))
    half = 0.08 * person.stature / 1.7
    seat = Block((0.0, height / 2, -0.02), (half, height / 2, half), material="stone", surface="seat")
    posture = PoseBuilder((rng.uniform(-2, 6), 0, 0)).trunk(rng.uniform(6, 16), rng.uniform(-3, 3))
    touches = solo_actions.seated_legs(posture, person, rng, height)
    for side in _SIDES:
        posture.leg(side, 92 + rng.uniform(-2, 2), 88 + rng.uniform(-3, 3), spread=rng.uniform(1, 4))
        posture.foot(side, out=rng.uniform(0, 6))
        posture.arm(side, (0.22, -1, 0.35), (-0.2, -0.1, 1), (-0.5, -1, 0)).fingers(side, 15, rng)
    posture.head(rng.uniform(0, 10), rng.uniform(-20, 20))
    touches = tuple(touch for touch in touches if not touch.patch.endswith("thigh"))
    pelvis = (0.0, height + person.seat + 0.02, 0.0)
    azimuth = (-12.0, 12.0)
    return PosePlan(
        "sit_on_pedestal", posture.pose, person.betas, pelvis, (seat,), touches, drift=0.03, azimuth=azimuth
    )


def hang_from_bar(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person who hangs from a horizontal bar with straight arms, feet in the air."""
    wide, size = float(rng.uniform(0.21, 0.27)) * person.stature / 1.7, person.stature / 1.7
    lean = float(rng.uniform(-4, 4))
    posture = PoseBuilder((lean, 0, 0)).trunk(rng.uniform(-4, 4), rng.uniform(-4, 4))
    posture.head(rng.uniform(-12, 8), rng.uniform(-15, 15))
    bend = rng.uniform(0, 70) if rng.random() < 0.5 else rng.uniform(0, 10)
    for side in _SIDES:
        posture.leg(side, rng.uniform(-4, 8) + bend * 0.15, bend + rng.uniform(0, 5), apart=rng.uniform(0, 5))
        posture.ankle(side, point=rng.uniform(15, 40))
        posture.arm(side, (0.18, 1, 0.05), (-0.02, 1, 0.02), (0, 0.1, 1)).fingers(side, 52, rng)
    hands = person.shoulder + person.arm + 0.13 * size
    height = person.leg + hands + float(rng.uniform(0.12, 0.35))
    radius, long = 0.016, float(rng.uniform(0.60, 0.75))
    bar = Block((0.0, height, 0.06), (long, radius, radius), material="metal", rounding=radius)
    posts = tuple(
        Block((sign * (long - 0.02), height / 2, 0.06), (0.03, height / 2, 0.03), material="metal") for sign in (1, -1)
    )
    touches = tuple(ContactTarget(f"{side}_palm", 0.25, blocks=(0,)) for side in _SIDES)
    reaches = tuple(
        PositionTarget(f"{side}_palm", (sign * wide, height, 0.06), 0.03)
        for side, sign in zip(_SIDES, (1, -1), strict=True)
    )
    pelvis = (0.0, height - hands, 0.0)
    return PosePlan("hang_from_bar", posture.pose, person.betas, pelvis, (bar, *posts), touches, reaches, drift=0.05)


def on_all_fours(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person on hands and knees."""
    posture = PoseBuilder((rng.uniform(72, 82), 0, 0)).trunk(rng.uniform(0, 10), rng.uniform(-4, 4))
    posture.head(-rng.uniform(10, 40), rng.uniform(-15, 15))
    touches: tuple[ContactTarget, ...] = ()
    for side in _SIDES:
        posture.leg(side, rng.uniform(-4, 6), 88, apart=rng.uniform(3, 7)).ankle(side, point=45)
        posture.arm(side, (0.08, -1, 0.12), (-0.02, -1, 0.02), (0, -0.3, -1), wrist=70).fingers(side, 3, rng)
        touches += (
            ContactTarget(f"{side}_palm", 0.35),
            ContactTarget(f"{side}_knee", 0.3),
            ContactTarget(f"{side}_instep", 0.15),
        )
    pelvis = (0.0, person.thigh + 0.07, 0.0)
    return PosePlan("on_all_fours", posture.pose, person.betas, pelvis, touches=touches)


# ---- things that give way ------------------------------------------------------------------------------------------


def sit_on_cushion(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person who sinks into the seat of a sofa."""
    soft = float(rng.uniform(0.03, 0.08))
    height = min(float(rng.uniform(0.36, 0.41)), max(0.28, solo_actions.knee_hollow_height(person))) + soft
    deep = min(float(rng.uniform(0.46, 0.53)), person.thigh + person.behind - 0.08)
    sofa = furniture.sofa(rng, height=height, depth=deep, recline=float(rng.uniform(0.20, 0.30)))
    cushion = replace(sofa[0], soft=soft)
    room = sofa[0].half[0] - 0.35
    plan = solo_actions.sit_on_sofa(person, rng, float(rng.uniform(-room, room)), (cushion.pressed(), *sofa[1:]))
    touches = tuple(touch for touch in plan.touches if touch.on == "scene")
    return replace(plan, action="sit_on_cushion", blocks=(cushion, *sofa[1:]), touches=touches)


def lie_on_mattress(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person on the back who sinks into the mattress of a bed."""
    pillow = float(rng.uniform(0.05, 0.07))
    bed = furniture.bed(rng, pillow=pillow)
    level, head = bed[0].centre[1] + bed[0].half[1], 0.40 * person.stature
    plan = solo_actions.lie_on_back(person, rng, 2 * bed[3].half[1])
    soft = float(rng.uniform(0.03, 0.06))
    plan = solo_actions.move_plan(plan, (0.0, -bed[0].half[2] + 0.22 + head), 0.0, level - soft)
    return replace(plan, action="lie_on_mattress", blocks=(replace(bed[0], soft=soft), *bed[1:]))


# ---- small objects -------------------------------------------------------------------------------------------------


def laptop_on_lap(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person on a chair with a laptop on the thighs and both hands on it."""
    posture, plan = _seated(person, rng, "laptop_on_lap")
    size = person.stature / 1.7
    seat = plan.blocks[4]
    top = seat.centre[1] + seat.half[1] + 0.180 * size
    near = plan.pelvis[2] + person.behind + 0.09 * size
    open_at, deep, high = float(rng.uniform(0.15, 0.45)), 0.115, 0.105
    base = Block((0.0, top, near + deep), (0.165, 0.010, deep), material="metal", item="laptop")
    hinge = near + 2 * deep
    lid = Block(
        (0.0, top + high * float(np.cos(open_at)), hinge + high * float(np.sin(open_at)) + 0.006),
        (0.165, high, 0.005),
        pitch=open_at,
        material="metal",
        item="laptop",
    )
    index = len(plan.blocks)
    for side in _SIDES:
        posture.leg(side, 92, 88 - rng.uniform(-4, 6), spread=rng.uniform(1, 5)).foot(side, out=4)
        posture.arm(side, (0.24, -1, 0.22), (-0.22, -0.12, 1), (0, -1, 0)).fingers(side, 8, rng)
    posture.head(rng.uniform(18, 30), rng.uniform(-6, 6))
    touches = [
        ContactTarget(f"{side}_{patch}", share, blocks=(index,))
        for side in _SIDES
        for patch, share in (("lap", 0.15), ("palm", 0.15))
    ]
    reaches = tuple(
        PositionTarget(f"{side}_palm", (sign * 0.09, top + 0.01, float(near) + 0.10), 0.05)
        for side, sign in zip(_SIDES, (1, -1), strict=True)
    )
    plan = replace(plan, blocks=(*plan.blocks, base, lid), reaches=reaches)
    return _finished(plan, posture, *touches)


def hold_ball(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a standing or sitting person with palms that face each other, apart for a ball."""
    make = _seated if rng.random() < 0.4 else _standing
    posture, plan = make(person, rng, "hold_ball")
    up = rng.uniform(0.05, 0.6)
    for side in _SIDES:
        posture.arm(side, (0.30, -1, 0.35), (-0.18, up, 1), (-1, 0, 0)).fingers(side, 12, rng)
    return _finished(plan, posture)


def hold_cup(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a standing or sitting person with one hand bent around a cup."""
    make = _seated if rng.random() < 0.5 else _standing
    posture, plan = make(person, rng, "hold_cup")
    side = str(rng.choice(_SIDES))
    up = rng.uniform(-0.05, 0.5)
    posture.arm(side, (0.28, -1, 0.25), (-0.25, up, 1), (-1, 0, 0.1)).fingers(side, 32, rng)
    away = _other(side)
    if plan.blocks:
        touches = solo_actions.lay_hand_on_thigh(posture, away, rng)
    else:
        touches = ()
        posture.arm(away, (0.22, -1, 0.0), (0.05, -1, 0.3), (-1, 0, -0.2)).fingers(away, 15, rng)
    return _finished(plan, posture, *touches)


CONTACT_ACTIONS: dict[str, Callable[[MeasuredBody, np.random.Generator], PosePlan]] = {
    "cross_arms": cross_arms,
    "hands_on_hips": hands_on_hips,
    "hands_on_knees": hands_on_knees,
    "clasp_hands": clasp_hands,
    "chin_on_hand": chin_on_hand,
    "lean_on_post": lean_on_post,
    "sit_on_pedestal": sit_on_pedestal,
    "hang_from_bar": hang_from_bar,
    "on_all_fours": on_all_fours,
    "sit_on_cushion": sit_on_cushion,
    "lie_on_mattress": lie_on_mattress,
    "laptop_on_lap": laptop_on_lap,
    "hold_ball": hold_ball,
    "hold_cup": hold_cup,
}
"""Action name -> function that plans it for one person."""
