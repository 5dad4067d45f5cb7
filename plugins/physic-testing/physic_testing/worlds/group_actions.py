"""Actions of several people: hugging, sitting side by side, groups, slopes and outdoor steps.

Poses are fitted one person at a time, with the others fixed; people who touch each other are fitted in two rounds.
The room's frame (x right, y up, z towards the camera's side), metres.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.worlds import furniture, solo_actions
from physic_testing.worlds.contact_fit import ContactFit, ContactTarget, OtherPerson, PosePlan, fit_contacts, pose_body
from physic_testing.worlds.pose_builder import PoseBuilder
from physic_testing.worlds.reproducible_math import sin_cos
from physic_testing.worlds.solids import LEVEL_GROUND, Block, Ground
from physic_testing.worlds.solo_actions import SOLO_ACTIONS, MeasuredBody, draw_person, move_plan

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.body.model import BodyModel

__all__ = [
    "FittedGroup",
    "draw_pair",
    "fit_in_turns",
    "group",
    "hug",
    "on_slope",
    "outdoor_steps",
    "sit_side_by_side",
]


@dataclass(frozen=True)
class FittedGroup:
    """Several people with fitted poses.

    Attributes:
        plans: plan of each person.
        settled: fitted pose of each person.
        blocks: all blocks.
        ground: ground plane.
    """

    plans: tuple[PosePlan, ...]
    settled: tuple[ContactFit, ...]
    blocks: tuple[Block, ...]
    ground: Ground = LEVEL_GROUND


def hug(model: BodyModel, rng: np.random.Generator) -> FittedGroup:
    """Fit two people who hug face to face, or stand side by side with an arm around each other."""
    first, second = draw_pair(model, rng)
    if rng.random() < 0.6:
        apart = first.behind + second.behind + rng.uniform(0.10, 0.14)
        aside = rng.uniform(0.03, 0.06)  # heads pass each other
        plans = [_embrace(first, rng), _embrace(second, rng)]
        plans = [move_plan(plans[0], (aside, -apart / 2), 0.0), move_plan(plans[1], (-aside, apart / 2), np.pi)]
    else:
        plans = _arm_in_arm(first, second, rng)
    return fit_in_turns(model, plans, rounds=2)


def draw_pair(model: BodyModel, rng: np.random.Generator) -> tuple[MeasuredBody, MeasuredBody]:
    """Draw two people of similar size and different shape."""
    first = draw_person(model, rng, adult=True)
    betas = draw_person(model, rng, adult=True).betas.copy()
    betas[0] = np.clip(first.betas[0] + rng.uniform(-0.5, 0.5), -1.0, 1.2)
    return first, solo_actions.measure_person(model, betas)


def _embrace(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan one of two hugging people: left arm over the other's shoulder, right arm under the other's arm."""
    posture = PoseBuilder((rng.uniform(2, 6), 0, 0)).trunk(rng.uniform(2, 8), rng.uniform(-3, 3))
    for side in ("left", "right"):
        posture.leg(side, rng.uniform(-2, 3), rng.uniform(0, 4), apart=rng.uniform(3, 6)).foot(side, out=8)
    posture.head(rng.uniform(0, 10), -rng.uniform(5, 25), -rng.uniform(4, 10))
    posture.arm("left", (0.42, 0.10, 1), (-0.75, -0.25, 0.55), (-0.3, -0.2, -1)).fingers("left", 10, rng)
    posture.arm("right", (0.50, -0.62, 0.9), (-0.75, -0.02, 0.62), (-0.3, 0, -1)).fingers("right", 10, rng)
    touches = (
        ContactTarget("left_sole", 0.6),
        ContactTarget("right_sole", 0.6),
        ContactTarget("left_palm", 0.2, on="people", target="back"),
        ContactTarget("right_palm", 0.2, on="people", target="back"),
    )
    return PosePlan("hug", posture.pose, person.betas, (0.0, person.leg - 0.005, 0.0), touches=touches, balanced=True)


def _arm_in_arm(first: MeasuredBody, second: MeasuredBody, rng: np.random.Generator) -> list[PosePlan]:
    """Plan two people side by side; the first lays the left arm around the other's shoulders."""
    apart = 0.44 * (first.stature + second.stature) / 3.4
    plans = []
    for person, x, near in ((first, -apart / 2, "left"), (second, apart / 2, "right")):
        plan = move_plan(solo_actions.stand(person, rng), (x, 0.0), 0.0)
        posture = PoseBuilder()
        posture.pose[:] = plan.pose
        touches = list(plan.touches)
        if near == "left":
            posture.arm("left", (1, 0.02, -0.30), (1, -0.10, 0.05), (0.1, -1, 0)).fingers("left", 12, rng)
            touches.append(ContactTarget("left_palm", 0.15, on="people", target="left_shoulder"))
            posture.arm("right", (0.2, -1, 0.0), (0.05, -1, 0.3), (-1, 0, 0)).fingers("right", 15, rng)
        else:
            low = rng.random() < 0.5  # the near arm hangs, or goes round the other's waist
            upper, fore = ((0.5, -1, -0.45), (0.8, -0.42, -0.12)) if low else ((0.05, -1, 0.0), (0.0, -1, 0.2))
            posture.arm("right", upper, fore, (0.2, -0.1, 1) if low else (-1, 0, 0)).fingers("right", 12, rng)
            if low:
                touches.append(ContactTarget("right_palm", 0.15, on="people", target="back"))
            posture.arm("left", (0.2, -1, 0.05), (0.05, -1, 0.35), (-1, 0, 0)).fingers("left", 15, rng)
        plans.append(replace(plan, action="hug", pose=posture.pose, touches=tuple(touches), balanced=False, drift=0.05))
    return plans


def sit_side_by_side(model: BodyModel, rng: np.random.Generator) -> FittedGroup:
    """Fit two people who sit close together on a sofa or bench."""
    people = draw_pair(model, rng)
    size = sum(person.stature for person in people) / 3.4
    half = size * float(rng.uniform(0.28, 0.35))
    small = min(people, key=lambda person: person.stature)
    if rng.random() < 0.6:
        deep = min(float(rng.uniform(0.46, 0.52)), small.thigh + small.behind - 0.08)
        height = min(float(rng.uniform(0.38, 0.43)), solo_actions.knee_hollow_height(small))
        seat = furniture.sofa(
            rng,
            width=float(rng.uniform(1.4, 1.9)),
            height=max(height, 0.28),
            depth=deep,
            recline=float(rng.uniform(0.2, 0.3)),
        )
        plans = [solo_actions.sit_on_sofa(p, rng, x, seat) for p, x in zip(people, (-half, half), strict=True)]
    else:
        height = max(0.28, min(float(rng.uniform(0.42, 0.47)), solo_actions.knee_hollow_height(small)))
        seat = furniture.bench(rng, height=height)
        plans = [solo_actions.sit_on_bench(p, rng, x, seat) for p, x in zip(people, (-half, half), strict=True)]
    plans = [replace(plan, action="sit_side_by_side") for plan in plans]
    return fit_in_turns(model, plans, rounds=1, shared=seat)


def group(model: BodyModel, rng: np.random.Generator) -> FittedGroup:
    """Fit three to five people with different actions, in two rows."""
    count = int(rng.integers(3, 6))
    front = [str(a) for a in rng.permutation(["kneel", "squat", "sit_on_stool", "sit_on_floor", "sit_on_chair"])]
    back = [str(a) for a in rng.permutation(["stand", "walk", "stand", "sit_on_stool"])]
    before = count // 2
    plans: list[PosePlan] = []
    for row, names, number in ((0.5, front, before), (-0.5, back, count - before)):
        for k in range(number):
            x = (k - (number - 1) / 2) * rng.uniform(0.72, 0.85) + (0.2 if row > 0 else 0.0) + rng.uniform(-0.06, 0.06)
            plan = SOLO_ACTIONS[names[k]](draw_person(model, rng), rng)
            yaw = float(np.radians(rng.uniform(-25, 25)))
            plans.append(move_plan(plan, (float(x), float(row + rng.uniform(-0.1, 0.1))), yaw))
    return fit_in_turns(model, plans, rounds=1)


def on_slope(model: BodyModel, rng: np.random.Generator) -> FittedGroup:
    """Fit one or two people who stand or walk on ground with a slope of 4 to 13 degrees."""
    tilt, towards = np.radians(rng.uniform(4, 13)), rng.uniform(-np.pi, np.pi)
    (sine, cosine), (aside, ahead) = sin_cos(tilt), sin_cos(towards)
    normal = (float(sine * ahead), float(cosine), float(sine * aside))
    ground = Ground(normal, str(rng.choice(["grass", "paving"])))
    plans = []
    for x in (0.0,) if rng.random() < 0.6 else (-0.5, 0.5):
        name = str(rng.choice(["stand", "walk"]))
        place = (float(x), float(rng.uniform(-0.2, 0.2)))
        plan = SOLO_ACTIONS[name](draw_person(model, rng), rng)
        plans.append(move_plan(plan, place, float(np.radians(rng.uniform(-60, 60))), ground.height_at(*place)))
    return fit_in_turns(model, plans, rounds=1, ground=ground)


def outdoor_steps(model: BodyModel, rng: np.random.Generator) -> FittedGroup:
    """Fit one to three people who sit or stand on wide stone steps, or in front of them."""
    blocks = solo_actions.steps_outside(rng)
    places = [[0.0], [-0.55, 0.55], [-0.9, 0.0, 0.9]][int(rng.integers(0, 3))]
    plans = []
    for x in places:
        at = float(x + rng.uniform(-0.1, 0.1))
        person = draw_person(model, rng)
        if rng.random() < 0.5:
            plans.append(solo_actions.sit_on_steps(person, rng, blocks, at))
        else:
            plans.append(solo_actions.stand_on_steps(person, rng, blocks, at, int(rng.integers(0, 4))))
    ground = Ground(material=str(rng.choice(["grass", "paving"])))
    return fit_in_turns(model, plans, rounds=1, ground=ground, shared=blocks)


def fit_in_turns(
    model: BodyModel,
    plans: Sequence[PosePlan],
    rounds: int,
    ground: Ground = LEVEL_GROUND,
    shared: tuple[Block, ...] = (),
) -> FittedGroup:
    """Fit each person in turn, with the others fixed; in the first round only those already fitted.

    Args:
        model: body model in float64.
        plans: one plan per person; if ``shared`` is given, each has exactly these blocks.
        rounds: 2 if people touch each other.
        ground: ground plane.
        shared: blocks common to all plans.
    """
    everything = shared or tuple(block for plan in plans for block in plan.blocks)
    bodies: dict[int, OtherPerson] = {}
    settled: dict[int, ContactFit] = {}
    for number in range(rounds):
        for i, plan in enumerate(plans):
            around = () if shared else tuple(b for j, other in enumerate(plans) if j != i for b in other.blocks)
            neighbours = [body for j, body in bodies.items() if j != i]
            wanted = plan
            if not neighbours:
                wanted = replace(plan, touches=tuple(t for t in plan.touches if t.on != "people"))
            if number:
                _, joints = pose_body(model, settled[i].pose, plan.betas, settled[i].transl)
                x, y, z = (float(c) for c in joints[0])
                wanted = replace(wanted, pose=settled[i].pose, pelvis=(x, y, z))
            settled[i] = fit_contacts(model, wanted, around=around, ground=ground, neighbours=neighbours)
            bodies[i] = OtherPerson(pose_body(model, settled[i].pose, plan.betas, settled[i].transl)[0])
    return FittedGroup(tuple(plans), tuple(settled[i] for i in range(len(plans))), everything, ground)
