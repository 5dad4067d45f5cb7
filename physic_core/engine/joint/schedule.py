"""Schedule of the joint optimisation: restarts, and the step at which contact and penetration start."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from physic_core.engine.joint.acceptance import best_of, per_person, values_of
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.optimiser import Trace, minimise
from physic_core.engine.joint.settings import JointSettings, LbfgsSettings
from physic_core.geometry.camera import project

__all__ = ["RESTART_ERROR", "VARIANTS", "pick_starts", "run"]

RESTART_ERROR = 0.04
"""Restarts are tried for people whose final reprojection error exceeds this share of the person's size."""

_SCENE_TERMS = ("contact", "penetration", "floor", "soles")

Progress = Callable[[float], None]

_TILT = math.radians(15.0)
_FARTHER = math.log(1.1)

VARIANTS: tuple[tuple[float, float], ...] = ((_TILT, 0.0), (-_TILT, 0.0), (0.0, _FARTHER), (0.0, -_FARTHER))
"""Restarts: a rotation about the camera's horizontal axis, radians, and a change of the logarithm of depth."""


def run(energy: JointEnergy, settings: JointSettings, progress: Progress | None = None) -> Trace:
    """Minimise the joint energy from its present state, in place.

    Args:
        energy: refreshed, and finite at its present state.
        settings: of stage 3.
        progress: called with the completed share of the steps, 0-1.
    """
    origin = energy.state.pack()
    first = _follow(energy, settings, progress)
    if settings.start_poses == 1:
        return first
    if not bool((_reprojection_share(energy) >= RESTART_ERROR).any()):
        return first
    reached = energy.state.pack()
    energy.state.load(origin)
    energy.refresh()
    spent = pick_starts(energy, settings)
    second = _follow(energy, settings, None)
    best_of(energy, (reached, energy.state.pack()), refresh=True)
    with torch.no_grad():
        end = values_of(energy())
    return replace(
        second,
        start=first.start,
        end=end,
        evaluations=first.evaluations + spent + second.evaluations,
        steps=first.steps + second.steps,
    )


def _follow(energy: JointEnergy, settings: JointSettings, progress: Progress | None) -> Trace:
    """Minimise from the present state; the first steps leave out the scene where the settings delay it."""
    optimiser = settings.optimiser
    alone = round(settings.scene_after * optimiser.steps)
    if not alone:
        return minimise(energy, optimiser, progress)
    origin = energy.state.pack()
    energy.excluded = _SCENE_TERMS
    first = minimise(energy, replace(optimiser, steps=alone), _part(progress, 0.0, alone / optimiser.steps))
    energy.excluded = ()
    energy.refresh()
    rest = replace(optimiser, steps=optimiser.steps - alone)
    trace = minimise(energy, rest, _part(progress, settings.scene_after, 1.0))
    final = energy.state.pack()
    energy.state.load(origin)
    with torch.no_grad():
        start = values_of(energy())
    energy.state.load(final)
    return replace(
        trace, start=start, evaluations=trace.evaluations + first.evaluations, steps=trace.steps + first.steps
    )


def pick_starts(energy: JointEnergy, settings: JointSettings) -> int:
    """Try restarts for people with a large reprojection error, and set each person to their best start.

    Each start is optimised up to the first refresh, for all people at once. The other people and the scene's scale
    keep the start by the body estimator.

    Returns:
        Number of evaluations.
    """
    state = energy.state
    optimiser = settings.optimiser
    probe = replace(optimiser, steps=min(optimiser.refresh_steps, optimiser.steps))
    if isinstance(probe, LbfgsSettings):
        probe = replace(probe, tolerance=0.0)
    origin = state.pack()
    evaluations = minimise(energy, probe).evaluations
    energy.refresh()
    best, kept = _of_each(energy), {group: value.detach().clone() for group, value in state.values.items()}
    doubtful = _reprojection_share(energy) >= RESTART_ERROR
    for tilt, farther in VARIANTS[: settings.start_poses - 1] if bool(doubtful.any()) else ():
        state.load(origin)
        state.displace(doubtful, tilt, farther)
        energy.refresh()
        evaluations += minimise(energy, probe).evaluations
        energy.refresh()
        found = _of_each(energy)
        better = doubtful & (found < best)
        best = torch.where(better, found, best)
        for group, value in state.values.items():
            if group != "scale":
                rows = better.reshape(-1, *[1] * (value.ndim - 1))
                kept[group] = torch.where(rows, value.detach(), kept[group])
    with torch.no_grad():
        for group, value in state.values.items():
            value.copy_(kept[group])
    energy.refresh()
    return evaluations


@torch.no_grad()
def _of_each(energy: JointEnergy) -> Tensor:
    """(B,) energy of each person; inf where it is not finite."""
    total = per_person(energy())
    return torch.where(torch.isfinite(total), total, torch.inf)


@torch.no_grad()
def _reprojection_share(energy: JointEnergy) -> Tensor:
    """(B,) mean error of confident keypoints as a share of the person's size; inf for a person without them."""
    problem, context = energy.problem, energy.context
    estimate = energy.state.unpack()
    posed = context.pose(estimate.rotations, estimate.betas, estimate.transl, problem.expression0)
    error = (project(posed[problem.skeleton], problem.K) - context.keypoints.points).norm(dim=-1)
    confident = context.keypoints.confident.to(error.dtype)
    mean = (confident * error).sum(1) / confident.sum(1).clamp(min=1.0) / context.person_px
    return torch.where(confident.any(1), mean, torch.inf)


def _part(progress: Progress | None, begin: float, end: float) -> Progress | None:
    """Map progress 0-1 to the interval from ``begin`` to ``end``."""
    return None if progress is None else lambda share: progress(begin + (end - begin) * share)
