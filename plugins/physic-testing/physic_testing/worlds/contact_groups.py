"""Actions of two people who touch each other; the conventions are those of ``group_actions``."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.worlds import solo_actions
from physic_testing.worlds.contact_fit import ContactTarget, PosePlan
from physic_testing.worlds.group_actions import FittedGroup, draw_pair, fit_in_turns
from physic_testing.worlds.pose_builder import PoseBuilder
from physic_testing.worlds.solo_actions import MeasuredBody, draw_person, move_plan

if TYPE_CHECKING:
    from collections.abc import Callable

    from physic_core.body.model import BodyModel

__all__ = ["CONTACT_GROUPS"]

_SIDES = ("left", "right")


def _stand(
    person: MeasuredBody, rng: np.random.Generator, action: str, lean: float = 0.0
) -> tuple[PoseBuilder, PosePlan]:
    """Plan a standing person with hanging arms, who leans forward by ``lean`` degrees."""
    posture = PoseBuilder((lean, 0, 0)).trunk(rng.uniform(-1, 4), rng.uniform(-4, 4))
    posture.head(rng.uniform(0, 8), rng.uniform(-20, 20), rng.uniform(-4, 4))
    for side in _SIDES:
        posture.leg(side, lean + rng.uniform(-2, 3), rng.uniform(0, 5), apart=rng.uniform(2, 5))
        posture.foot(side, out=rng.uniform(4, 12))
        posture.arm(side, (0.20, -1, 0.05), (0.05, -1, 0.3), (-1, 0, -0.2)).fingers(side, 15, rng)
    soles = tuple(ContactTarget(f"{side}_sole", 0.6) for side in _SIDES)
    pelvis = (0.0, person.leg - 0.005, 0.0)
    return posture, PosePlan(action, posture.pose, person.betas, pelvis, touches=soles, drift=0.05)


def _with(plan: PosePlan, posture: PoseBuilder, *touches: ContactTarget) -> PosePlan:
    """Return the plan with the pose of the builder and more contact targets."""
    return replace(plan, pose=posture.pose, touches=(*plan.touches, *touches))


def hand_on_shoulder(model: BodyModel, rng: np.random.Generator) -> FittedGroup:
    """Fit two people side by side; the first lays the near hand on the other's near shoulder."""
    first, second = draw_pair(model, rng)
    apart = float(rng.uniform(0.58, 0.64)) * (first.stature + second.stature) / 3.4
    posture, plan = _stand(first, rng, "hand_on_shoulder")
    posture.arm("left", (1, 0.0, 0.12), (1, 0.05, -0.15), (0, -1, 0)).fingers("left", 14, rng)
    one = _with(plan, posture, ContactTarget("left_palm", 0.2, on="people", target="right_shoulder"))
    posture, plan = _stand(second, rng, "hand_on_shoulder")
    two = _with(plan, posture)
    plans = [move_plan(one, (-apart / 2, 0.0), 0.0), move_plan(two, (apart / 2, rng.uniform(-0.03, 0.03)), 0.0)]
    return fit_in_turns(model, plans, rounds=2)


def hold_hands(model: BodyModel, rng: np.random.Generator) -> FittedGroup:
    """Fit two people side by side who hold hands."""
    first, second = draw_pair(model, rng)
    apart = float(rng.uniform(0.62, 0.72)) * (first.stature + second.stature) / 3.4
    plans = []
    for person, near, back in ((first, "left", -1.0), (second, "right", 1.0)):
        posture, plan = _stand(person, rng, "hold_hands")
        away = "right" if near == "left" else "left"
        posture.arm(near, (0.28, -1, 0.08), (0.14, -1, 0.16), (0.1, 0, back)).fingers(near, 10, rng)
        palm = ContactTarget(f"{near}_palm", 0.3, on="people", target=f"{away}_palm")
        x = -apart / 2 if near == "left" else apart / 2
        plans.append(move_plan(_with(plan, posture, palm), (x, 0.03 * -back), 0.0))
    return fit_in_turns(model, plans, rounds=2)


def back_to_back(model: BodyModel, rng: np.random.Generator) -> FittedGroup:
    """Fit two people who stand or sit on the floor back to back."""
    people = draw_pair(model, rng)
    sitting = rng.random() < 0.5
    back = ContactTarget("upper_back", 0.15, on="people", target="back")
    apart = sum(person.behind for person in people)
    plans = []
    for person, yaw, sign in zip(people, (0.0, np.pi), (1, -1), strict=True):
        if sitting:
            posture = PoseBuilder((rng.uniform(-6, 0), 0, 0)).trunk(rng.uniform(2, 10), rng.uniform(-3, 3))
            posture.head(rng.uniform(0, 8), rng.uniform(-20, 20))
            touches: tuple[ContactTarget, ...] = (ContactTarget("gluteus", 0.2), back)
            for side in _SIDES:
                posture.leg(side, rng.uniform(118, 126), rng.uniform(100, 112), spread=rng.uniform(2, 8))
                posture.foot(side, out=5)
                posture.arm(side, (0.32, -0.75, 0.72), (-0.2, -0.15, 1), (-0.5, -0.9, 0)).fingers(side, 14, rng)
                touches += (
                    ContactTarget(f"{side}_sole", 0.5),
                    ContactTarget(f"{side}_palm", 0.10, on="self", target=f"{side}_knee"),
                )
            pelvis = (0.0, 0.105 * person.stature / 1.7, 0.0)
            plan = PosePlan("back_to_back", posture.pose, person.betas, pelvis, touches=touches, drift=0.06)
        else:
            posture, plan = _stand(person, rng, "back_to_back", lean=-3)
            if rng.random() < 0.5:
                for side, up in zip(_SIDES, (0.12, -0.02), strict=True):
                    posture.arm(side, (0.34, -1, 0.22), (-0.75, up, 0.62), (0, -1, 0.2)).fingers(side, 12, rng)
            plan = _with(plan, posture, back)
        plans.append(move_plan(plan, (0.0, sign * apart / 2), yaw))
    return fit_in_turns(model, plans, rounds=2)


def child_on_lap(model: BodyModel, rng: np.random.Generator) -> FittedGroup:
    """Fit an adult on a chair with a child on the lap."""
    adult, child = draw_person(model, rng, adult=True), _draw_child(model, rng)
    plan = replace(solo_actions.sit_on_chair(adult, rng), action="child_on_lap")
    seat = plan.blocks[4]
    level = seat.centre[1] + seat.half[1]
    posture = PoseBuilder((rng.uniform(-6, 0), 0, 0)).trunk(rng.uniform(2, 8), rng.uniform(-3, 3))
    touches = solo_actions.seated_legs(posture, adult, rng, level)
    posture.head(rng.uniform(5, 15), rng.uniform(-15, 15))
    for side in _SIDES:
        posture.leg(side, 92, 90 - rng.uniform(-3, 6), spread=rng.uniform(3, 7)).foot(side, out=5)
        posture.arm(side, (0.75, -0.9, 0.5), (-0.30, -0.10, 1), (-1, -0.2, 0)).fingers(side, 14, rng)
        touches += (ContactTarget(f"{side}_palm", 0.12, on="people"),)
    holder = replace(plan, pose=posture.pose, touches=touches)
    posture = PoseBuilder((rng.uniform(-2, 6), 0, 0)).trunk(rng.uniform(2, 10), rng.uniform(-4, 4))
    posture.head(rng.uniform(0, 10), rng.uniform(-25, 25))
    for side in _SIDES:
        posture.leg(side, 88, rng.uniform(60, 80), spread=rng.uniform(4, 10)).ankle(side, point=rng.uniform(5, 25))
        posture.arm(side, (0.22, -1, 0.35), (-0.05, -0.4, 1), (0, -1, 0)).fingers(side, 14, rng)
    carried = (
        ContactTarget("gluteus", 0.15, on="people", target="lap"),
        ContactTarget("left_thigh", 0.15, on="people", target="lap"),
        ContactTarget("right_thigh", 0.15, on="people", target="lap"),
    )
    size = adult.stature / 1.7
    pelvis = (
        0.0,
        level + 0.15 * size + child.seat + 0.02,
        holder.pelvis[2] + 0.14 * size + child.behind + 0.03,
    )
    sitter = PosePlan("child_on_lap", posture.pose, child.betas, pelvis, touches=carried, drift=0.05)
    return fit_in_turns(model, [holder, sitter], rounds=2)


def _draw_child(model: BodyModel, rng: np.random.Generator) -> MeasuredBody:
    """Draw a child."""
    betas = 0.6 * np.clip(rng.normal(0, 0.6, model.num_betas), -1.3, 1.3)
    betas[0] = rng.uniform(-3.6, -2.6)
    return solo_actions.measure_person(model, betas)


CONTACT_GROUPS: dict[str, Callable[[BodyModel, np.random.Generator], FittedGroup]] = {
    "hand_on_shoulder": hand_on_shoulder,
    "hold_hands": hold_hands,
    "back_to_back": back_to_back,
    "child_on_lap": child_on_lap,
}
"""Action name -> function that fits it."""
