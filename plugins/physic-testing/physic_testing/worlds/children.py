"""Children in worlds, alone and with adults: bodies as Anny shapes them, and their actions.

A child is a shape of its own beside the shape components of the embedded body: the components come near, and what they
cannot express is a further component of each child. The room's frame (x right, y up, z towards the camera's side),
metres.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.worlds.contact_fit import ContactTarget
from physic_testing.worlds.group_actions import FittedGroup, fit_in_turns
from physic_testing.worlds.pose_builder import PoseBuilder
from physic_testing.worlds.solo_actions import SOLO_ACTIONS, MeasuredBody, draw_person, measure_person, move_plan

if TYPE_CHECKING:
    from collections.abc import Callable

    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray

__all__ = ["CHILD_ACTIONS", "age_of", "with_children"]

_APART_M = (0.7, 1.3)  # between child and adult, beside each other
_BEHIND_M = (-0.8, 0.8)  # of the child, behind the adult


@cache
def _baked() -> dict[str, FloatArray]:
    """Return the arrays of ``children.npz`` (``tools/bake_children.py``)."""
    with np.load(Path(__file__).with_name("children.npz")) as file:
        return {name: file[name] for name in ("age", "betas", "residual", "step_m", "joints")}


def with_children(model: BodyModel) -> BodyModel:
    """Return the embedded body with one more shape component for each child.

    Args:
        model: embedded body in float64.
    """
    import torch

    baked, skin, kinematics = _baked(), model.skin, model.kinematics
    residual = torch.from_numpy(baked["residual"].astype(np.float64) * float(baked["step_m"]))
    joints = torch.from_numpy(baked["joints"].astype(np.float64))
    return replace(
        model,
        num_betas=model.num_betas + len(residual),
        skin=replace(skin, directions=torch.cat([skin.directions, residual.permute(0, 2, 1)])),
        kinematics=replace(kinematics, directions=torch.cat([kinematics.directions, joints.flatten(1)])),
    )


def age_of(betas: FloatArray) -> float:
    """Return the age of a body of :func:`with_children`, years; NaN for an adult."""
    own = betas[_baked()["betas"].shape[1] :]
    return float(_baked()["age"][own.argmax()]) if own.any() else np.nan


def _draw_child(model: BodyModel, rng: np.random.Generator) -> MeasuredBody:
    """Draw one of the children."""
    baked = _baked()
    row = int(rng.integers(len(baked["age"])))
    return measure_person(model, np.concatenate([baked["betas"][row], np.eye(len(baked["age"]))[row]]))


def _draw_adult(model: BodyModel, rng: np.random.Generator) -> MeasuredBody:
    """Draw an adult."""
    betas = draw_person(model, rng, adult=True).betas.copy()
    betas[_baked()["betas"].shape[1] :] = 0
    return measure_person(model, betas)


def _alone(actions: tuple[str, ...]) -> Callable[[BodyModel, np.random.Generator], FittedGroup]:
    """Return a function that fits a child alone in one of the actions."""

    def cast(model: BodyModel, rng: np.random.Generator) -> FittedGroup:
        plan = SOLO_ACTIONS[str(rng.choice(actions))](_draw_child(model, rng), rng)
        return fit_in_turns(model, [move_plan(plan, (0.0, 0.0), float(np.radians(rng.uniform(-60, 60))))], rounds=1)

    return cast


def _beside_adult(
    of_adult: tuple[str, ...], of_child: tuple[str, ...]
) -> Callable[[BodyModel, np.random.Generator], FittedGroup]:
    """Return a function that fits a child beside an adult, each in one of their actions."""

    def cast(model: BodyModel, rng: np.random.Generator) -> FittedGroup:
        side = float(rng.choice([-1.0, 1.0]))
        place = (side * float(rng.uniform(*_APART_M)), -float(rng.uniform(*_BEHIND_M)))
        plans = []
        for person, actions, at in (
            (_draw_adult(model, rng), of_adult, (0.0, 0.0)),
            (_draw_child(model, rng), of_child, place),
        ):
            plan = SOLO_ACTIONS[str(rng.choice(actions))](person, rng)
            plans.append(move_plan(plan, at, float(np.radians(rng.uniform(-30, 30)))))
        return fit_in_turns(model, plans, rounds=1)

    return cast


def _by_the_hand(model: BodyModel, rng: np.random.Generator) -> FittedGroup:
    """Fit a child who stands beside an adult and is held by the hand."""
    adult, child = _draw_adult(model, rng), _draw_child(model, rng)
    apart = 0.17 * adult.stature + 0.14 * child.stature
    # The child's hand comes as high as the adult's, as far as the arm reaches.
    hand = adult.leg + adult.shoulder - 0.93 * adult.arm - 0.10
    rise = float(np.clip((hand - child.leg - child.shoulder) / child.arm, -1.0, 0.9))
    out = float(np.sqrt(1 - rise**2)) + 0.1
    plans = []
    for person, near, upper, fore in (
        (adult, "left", (0.28, -1, 0.08), (0.14, -1, 0.16)),
        (child, "right", (out, rise, 0.1), (out, rise, 0.2)),
    ):
        plan = SOLO_ACTIONS["stand"](person, rng)
        posture = PoseBuilder()
        posture.pose[:] = plan.pose
        posture.arm(near, upper, fore, (0.1, 0, -1)).fingers(near, 12, rng)
        palm = ContactTarget(f"{near}_palm", 0.15, on="people", target=f"{'right' if near == 'left' else 'left'}_palm")
        soles = tuple(touch for touch in plan.touches if "sole" in touch.patch)
        x = -apart / 2 if person is adult else apart / 2
        plan = replace(plan, pose=posture.pose, touches=(*soles, palm), balanced=False, drift=0.05)
        plans.append(move_plan(plan, (x, 0.0), 0.0))
    return fit_in_turns(model, plans, rounds=2)


CHILD_ACTIONS: dict[str, Callable[[BodyModel, np.random.Generator], FittedGroup]] = {
    "child_stands": _alone(("stand", "stand", "walk")),
    "child_sits": _alone(("sit_on_floor", "sit_on_stool", "kneel")),
    "child_stands_by_adult": _beside_adult(("stand", "walk"), ("stand", "walk")),
    "child_sits_by_adult": _beside_adult(
        ("sit_on_chair", "sit_on_stool", "kneel", "squat"), ("stand", "sit_on_floor", "sit_on_stool")
    ),
    "child_by_the_hand": _by_the_hand,
}
"""Action name -> function that fits it."""
