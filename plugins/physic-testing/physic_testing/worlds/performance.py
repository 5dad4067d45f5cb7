"""Performances: settled people with what carries them, for each action of the worlds.

The room's frame (x right, y up, z towards the camera's side, ground through the origin), metres.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError
from physic_testing.worlds import company
from physic_testing.worlds.actions import SOLO, draw_person, turned
from physic_testing.worlds.company import Cast
from physic_testing.worlds.settling import Plan, Settled, settle
from physic_testing.worlds.solids import FLAT, GROUND_MATERIALS, Block, Ground

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray

__all__ = ["ACTIONS", "Actor", "Performance", "perform"]

_TRIES = 3
_DEPTH, _GAP, _CROSSING = 0.008, 0.015, 0.02  # metres beyond which another draw is tried


@dataclass(frozen=True)
class Actor:
    """A settled person.

    Attributes:
        pose: (55, 3) rotation vectors, radians.
        betas: (K,).
        transl: (3,) metres.
        residual: metres by which at most a vertex lies inside something, or a patch of skin misses what it rests on.
        action: what they do.
    """

    pose: FloatArray
    betas: FloatArray
    transl: FloatArray
    residual: float
    action: str


@dataclass(frozen=True)
class Performance:
    """What an action brings onto the stage, around the origin.

    Attributes:
        actors: the people.
        blocks: what carries or hides them.
        ground: below everything.
        outdoors: whether it plays in the open.
        azimuth: degrees between which the camera may look, 0 from +z, 90 from +x.
        fills: "whole" where the camera shows people whole, "upper" where it may cut or hide legs.
    """

    actors: tuple[Actor, ...]
    blocks: tuple[Block, ...]
    ground: Ground = FLAT
    outdoors: bool = False
    azimuth: tuple[float, float] = (-180.0, 180.0)
    fills: str = "whole"


def perform(name: str, model: BodyModel, rng: np.random.Generator) -> Performance:
    """Draw and settle one performance.

    Args:
        name: one of ACTIONS.
        model: in float64.
        rng: draws people, furniture and poses. What is drawn depends on nothing else.

    Raises:
        InputError: there is no such action.
    """
    if name not in ACTIONS:
        raise InputError(f"There is no action named {name!r}: choose one of {', '.join(ACTIONS)}.")
    best: tuple[float, Performance] | None = None
    seeds = rng.integers(2**63, size=_TRIES)
    for seed in seeds:
        drawn = ACTIONS[name](model, np.random.default_rng(seed))
        if best is None or drawn.badness < best[0]:
            best = drawn.badness, drawn.performance
        if best[0] <= 1:
            break
    assert best is not None
    return best[1]


@dataclass(frozen=True)
class _Draw:
    """A performance and how far it is from a good one: 1 is just good."""

    performance: Performance
    badness: float


def _badness(settled: Sequence[Settled]) -> float:
    return max(max(s.depth / _DEPTH, s.gap / _GAP, s.crossing / _CROSSING) for s in settled)


def _actor(plan: Plan, settled: Settled) -> Actor:
    return Actor(settled.pose, plan.betas, settled.transl, settled.residual, plan.action)


def _alone(
    action: str, turn: float, azimuth: tuple[float, float], fills: str = "whole", outdoors: float = 0.0
) -> Callable[[BodyModel, np.random.Generator], _Draw]:
    """One person who does one thing, turned by up to so many degrees, sometimes in the open."""

    def draw(model: BodyModel, rng: np.random.Generator) -> _Draw:
        plan = SOLO[action](draw_person(model, rng), rng)
        plan = turned(plan, (0.0, 0.0), float(np.radians(rng.uniform(-turn, turn))))
        settled = settle(model, plan)
        outside = bool(rng.random() < outdoors)
        ground = Ground(material=str(rng.choice(GROUND_MATERIALS[1:]))) if outside else FLAT
        shown = Performance((_actor(plan, settled),), plan.blocks, ground, outside, plan.azimuth or azimuth, fills)
        return _Draw(shown, _badness([settled]))

    return draw


def _climb(model: BodyModel, rng: np.random.Generator) -> _Draw:
    """From one side, so that the staircase hides no foot."""
    azimuth = (35.0, 150.0) if rng.random() < 0.5 else (-150.0, -35.0)
    return _alone("climb_step", 10, azimuth)(model, rng)


def _together(
    cast: Callable[[BodyModel, np.random.Generator], Cast],
    azimuth: tuple[float, float],
    *,
    outdoors: float = 0.0,
) -> Callable[[BodyModel, np.random.Generator], _Draw]:
    """People who are settled together; in the open with a probability, which draws the ground of a level floor."""

    def draw(model: BodyModel, rng: np.random.Generator) -> _Draw:
        made = cast(model, rng)
        outside = bool(rng.random() < outdoors)
        ground = made.ground
        if outside and ground == FLAT:
            ground = Ground(material=str(rng.choice(GROUND_MATERIALS[1:])))
        actors = tuple(_actor(plan, settled) for plan, settled in zip(made.plans, made.settled, strict=True))
        return _Draw(Performance(actors, made.blocks, ground, outside, azimuth), _badness(made.settled))

    return draw


ACTIONS: dict[str, Callable[[BodyModel, np.random.Generator], _Draw]] = {
    "stand": _alone("stand", 40, (-180, 180), outdoors=0.4),
    "walk": _alone("walk", 60, (-180, 180), outdoors=0.5),
    "sit_on_chair": _alone("sit_on_chair", 30, (-100, 100)),
    "sit_on_sofa": _alone("sit_on_sofa", 15, (-60, 60)),
    "sit_on_stool": _alone("sit_on_stool", 40, (-150, 150)),
    "sit_on_floor": _alone("sit_on_floor", 40, (-110, 110)),
    "lie": _alone("lie", 15, (-60, 60)),
    "lean_on_wall": _alone("lean_on_wall", 10, (-70, 70)),
    "lean_on_table": _alone("lean_on_table", 30, (-120, 120)),
    "kneel": _alone("kneel", 40, (-150, 150)),
    "squat": _alone("squat", 40, (-150, 150), outdoors=0.3),
    "climb_step": _climb,
    "sit_behind_table": _alone("sit_behind_table", 0, (-30, 30), fills="upper"),
    "stand_behind_counter": _alone("stand_behind_counter", 0, (-40, 40), fills="upper"),
    "hug": _together(company.hug, (-180, 180), outdoors=0.4),
    "sit_side_by_side": _together(company.sit_side_by_side, (-50, 50)),
    "group": _together(company.group, (-35, 35)),
    "slope": _together(company.on_slope, (-180, 180), outdoors=1.0),
    "outdoor_steps": _together(company.outdoor_steps, (-60, 60), outdoors=1.0),
}
"""Name -> its draw."""
