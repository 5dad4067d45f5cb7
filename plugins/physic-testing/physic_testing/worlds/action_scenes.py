"""Random action scenes: people with fitted poses and their furniture.

The room's frame (x right, y up, z towards the camera's side, ground through the origin), metres.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError
from physic_testing.worlds import group_actions
from physic_testing.worlds.children import CHILD_ACTIONS
from physic_testing.worlds.contact_actions import CONTACT_ACTIONS
from physic_testing.worlds.contact_fit import ContactFit, PosePlan, fit_contacts, pose_body
from physic_testing.worlds.contact_groups import CONTACT_GROUPS
from physic_testing.worlds.group_actions import FittedGroup
from physic_testing.worlds.raised_feet import RAISED_ACTIONS
from physic_testing.worlds.small_objects import ball_between_palms, cup_in_hand
from physic_testing.worlds.solids import GROUND_MATERIALS, LEVEL_GROUND, Block, Ground
from physic_testing.worlds.solo_actions import SOLO_ACTIONS, draw_person, move_plan

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray

__all__ = ["ACTIONS", "RAISED_FEET_ACTIONS", "TOUCHING_ACTIONS", "ActionPose", "ActionScene", "draw_action"]

_TRIES = 3
_SOLO = SOLO_ACTIONS | CONTACT_ACTIONS | RAISED_ACTIONS
_DEPTH, _GAP, _CROSSING = 0.008, 0.015, 0.02  # metres beyond which another draw is tried


@dataclass(frozen=True)
class ActionPose:
    """A person with a fitted pose.

    Attributes:
        pose: (55, 3) rotation vectors, radians.
        betas: (K,) shape.
        transl: (3,) metres.
        residual: largest penetration or contact gap, m.
        action: name of the action.
    """

    pose: FloatArray
    betas: FloatArray
    transl: FloatArray
    residual: float
    action: str


@dataclass(frozen=True)
class ActionScene:
    """People and furniture of an action, around the origin.

    Attributes:
        actors: the people.
        blocks: furniture that supports or hides them, and small objects that they hold.
        ground: ground plane.
        outdoors: whether the scene is outdoors.
        azimuth: range of camera directions, degrees, 0 from +z, 90 from +x.
        fills: "whole" if the camera must show full bodies, "upper" if it may crop or hide legs.
    """

    actors: tuple[ActionPose, ...]
    blocks: tuple[Block, ...]
    ground: Ground = LEVEL_GROUND
    outdoors: bool = False
    azimuth: tuple[float, float] = (-180.0, 180.0)
    fills: str = "whole"


def draw_action(name: str, model: BodyModel, rng: np.random.Generator) -> ActionScene:
    """Draw up to three random action scenes with fitted poses, and return the best one.

    Args:
        name: key of ACTIONS, TOUCHING_ACTIONS, RAISED_FEET_ACTIONS or CHILD_ACTIONS.
        model: body model in float64; for CHILD_ACTIONS, that of ``children.with_children``.
        rng: random generator of people, furniture and poses.

    Raises:
        InputError: no action has this name.
    """
    actions = ACTIONS | TOUCHING_ACTIONS | RAISED_FEET_ACTIONS | _CHILD_DRAWS
    if name not in actions:
        raise InputError(f"There is no action named {name!r}: choose one of {', '.join(actions)}.")
    best: tuple[float, ActionScene] | None = None
    seeds = rng.integers(2**63, size=_TRIES)
    for seed in seeds:
        drawn = actions[name](model, np.random.default_rng(seed))
        if best is None or drawn.badness < best[0]:
            best = drawn.badness, drawn.action_scene
        if best[0] <= 1:
            break
    assert best is not None
    return best[1]


@dataclass(frozen=True)
class _ActionDraw:
    """An action scene and its badness; up to 1 is acceptable."""

    action_scene: ActionScene
    badness: float


def _badness(settled: Sequence[ContactFit]) -> float:
    """Return the largest error of the fitted poses in units of its tolerance."""
    return max(max(s.depth / _DEPTH, s.gap / _GAP, s.crossing / _CROSSING) for s in settled)


def _actor(plan: PosePlan, settled: ContactFit) -> ActionPose:
    """Combine a plan and its fitted pose to a person."""
    return ActionPose(settled.pose, plan.betas, settled.transl, settled.residual, plan.action)


def _one_person_action(
    action: str, turn: float, azimuth: tuple[float, float], fills: str = "whole", outdoors: float = 0.0
) -> Callable[[BodyModel, np.random.Generator], _ActionDraw]:
    """Return a function that draws one person's action, rotated by up to ``turn`` degrees, sometimes outdoors."""

    def draw(model: BodyModel, rng: np.random.Generator) -> _ActionDraw:
        plan = _SOLO[action](draw_person(model, rng), rng)
        plan = move_plan(plan, (0.0, 0.0), float(np.radians(rng.uniform(-turn, turn))))
        settled = fit_contacts(model, plan)
        blocks = (*plan.blocks, *_held(model, plan, settled))
        outside = bool(rng.random() < outdoors)
        ground = Ground(material=str(rng.choice(GROUND_MATERIALS[1:]))) if outside else LEVEL_GROUND
        shown = ActionScene((_actor(plan, settled),), blocks, ground, outside, plan.azimuth or azimuth, fills)
        return _ActionDraw(shown, _badness([settled]))

    return draw


def _held(model: BodyModel, plan: PosePlan, settled: ContactFit) -> tuple[Block, ...]:
    """Return the small object in the hands of a person with a fitted pose."""
    if plan.action not in ("hold_ball", "hold_cup"):
        return ()
    vertices, _ = pose_body(model, settled.pose, plan.betas, settled.transl)
    if plan.action == "hold_ball":
        return (ball_between_palms(model, vertices),)
    return (cup_in_hand(model, vertices, settled.pose),)


def _climb_step(model: BodyModel, rng: np.random.Generator) -> _ActionDraw:
    """Draw a person on stairs, seen from one side so that the stairs hide no foot."""
    azimuth = (35.0, 150.0) if rng.random() < 0.5 else (-150.0, -35.0)
    return _one_person_action("climb_step", 10, azimuth)(model, rng)


def _group_action(
    cast: Callable[[BodyModel, np.random.Generator], FittedGroup],
    azimuth: tuple[float, float],
    *,
    outdoors: float = 0.0,
) -> Callable[[BodyModel, np.random.Generator], _ActionDraw]:
    """Return a function that draws an action of several people, sometimes outdoors."""

    def draw(model: BodyModel, rng: np.random.Generator) -> _ActionDraw:
        made = cast(model, rng)
        outside = bool(rng.random() < outdoors)
        ground = made.ground
        if outside and ground == LEVEL_GROUND:
            ground = Ground(material=str(rng.choice(GROUND_MATERIALS[1:])))
        actors = tuple(_actor(plan, settled) for plan, settled in zip(made.plans, made.settled, strict=True))
        return _ActionDraw(ActionScene(actors, made.blocks, ground, outside, azimuth), _badness(made.settled))

    return draw


ACTIONS: dict[str, Callable[[BodyModel, np.random.Generator], _ActionDraw]] = {
    "stand": _one_person_action("stand", 40, (-180, 180), outdoors=0.4),
    "walk": _one_person_action("walk", 60, (-180, 180), outdoors=0.5),
    "sit_on_chair": _one_person_action("sit_on_chair", 30, (-100, 100)),
    "sit_on_sofa": _one_person_action("sit_on_sofa", 15, (-60, 60)),
    "sit_on_stool": _one_person_action("sit_on_stool", 40, (-150, 150)),
    "sit_on_floor": _one_person_action("sit_on_floor", 40, (-110, 110)),
    "lie": _one_person_action("lie", 15, (-60, 60)),
    "lean_on_wall": _one_person_action("lean_on_wall", 10, (-70, 70)),
    "lean_on_table": _one_person_action("lean_on_table", 30, (-120, 120)),
    "kneel": _one_person_action("kneel", 40, (-150, 150)),
    "squat": _one_person_action("squat", 40, (-150, 150), outdoors=0.3),
    "climb_step": _climb_step,
    "sit_behind_table": _one_person_action("sit_behind_table", 0, (-30, 30), fills="upper"),
    "stand_behind_counter": _one_person_action("stand_behind_counter", 0, (-40, 40), fills="upper"),
    "hug": _group_action(group_actions.hug, (-180, 180), outdoors=0.4),
    "sit_side_by_side": _group_action(group_actions.sit_side_by_side, (-50, 50)),
    "group": _group_action(group_actions.group, (-35, 35)),
    "slope": _group_action(group_actions.on_slope, (-180, 180), outdoors=1.0),
    "outdoor_steps": _group_action(group_actions.outdoor_steps, (-60, 60), outdoors=1.0),
}
"""Action name -> function that draws it."""

TOUCHING_ACTIONS: dict[str, Callable[[BodyModel, np.random.Generator], _ActionDraw]] = {
    "cross_arms": _one_person_action("cross_arms", 40, (-70, 70), outdoors=0.3),
    "hands_on_hips": _one_person_action("hands_on_hips", 40, (-180, 180), outdoors=0.3),
    "hands_on_knees": _one_person_action("hands_on_knees", 40, (-120, 120), outdoors=0.3),
    "clasp_hands": _one_person_action("clasp_hands", 30, (-70, 70)),
    "chin_on_hand": _one_person_action("chin_on_hand", 0, (-35, 35), fills="upper"),
    "lean_on_post": _one_person_action("lean_on_post", 0, (-12, 12), outdoors=0.5),
    "sit_on_pedestal": _one_person_action("sit_on_pedestal", 0, (-12, 12), outdoors=0.3),
    "hang_from_bar": _one_person_action("hang_from_bar", 20, (-120, 120), outdoors=0.6),
    "on_all_fours": _one_person_action("on_all_fours", 40, (-130, 130)),
    "sit_on_cushion": _one_person_action("sit_on_cushion", 15, (-60, 60)),
    "lie_on_mattress": _one_person_action("lie_on_mattress", 15, (-60, 60)),
    "laptop_on_lap": _one_person_action("laptop_on_lap", 20, (-80, 80)),
    "hold_ball": _one_person_action("hold_ball", 30, (-80, 80)),
    "hold_cup": _one_person_action("hold_cup", 30, (-80, 80)),
    "hand_on_shoulder": _group_action(CONTACT_GROUPS["hand_on_shoulder"], (-180, 180), outdoors=0.4),
    "hold_hands": _group_action(CONTACT_GROUPS["hold_hands"], (-180, 180), outdoors=0.4),
    "back_to_back": _group_action(CONTACT_GROUPS["back_to_back"], (-180, 180), outdoors=0.3),
    "child_on_lap": _group_action(CONTACT_GROUPS["child_on_lap"], (-70, 70)),
}
"""Action name -> function that draws it: contact with people, the own body, hidden or soft supports, small objects."""

RAISED_FEET_ACTIONS: dict[str, Callable[[BodyModel, np.random.Generator], _ActionDraw]] = {
    "jump": _one_person_action("jump", 60, (-180, 180), outdoors=0.6),
    "raise_foot": _one_person_action("raise_foot", 60, (-180, 180), outdoors=0.5),
    "vault": _one_person_action("vault", 20, (-150, 150), outdoors=0.7),
    "hold_bar": _one_person_action("hold_bar", 20, (-140, 140), outdoors=0.7),
    "sit_high": _one_person_action("sit_high", 30, (-110, 110), outdoors=0.5),
}
"""Action name -> function that draws it: one or both feet over the ground, on nothing."""

_CHILD_DRAWS = {name: _group_action(cast, (-60, 60), outdoors=0.4) for name, cast in CHILD_ACTIONS.items()}
