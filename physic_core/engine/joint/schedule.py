"""Schedule of the joint optimisation: restarts, and the step at which contact and penetration are added."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from physic_core.engine.joint.acceptance import finite_energy_per_person, select_lowest_energy, term_totals
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.optimiser import MinimisationResult, join_results, minimise
from physic_core.engine.joint.settings import JointSettings, LbfgsSettings

__all__ = ["RESTART_ERROR", "RESTART_OFFSETS", "minimise_with_restarts", "select_start_poses"]

RESTART_ERROR = 0.04
"""Smallest final reprojection error, in shares of the stature in px, for which restarts are tried."""

_LATE_TOLERANCE = 1e-3
"""Tolerance of the steps with late terms, which are a small share of an energy that has converged."""

_SCENE_TERMS = ("contact", "penetration", "floor", "soles")

Progress = Callable[[float], None]

_TILT = math.radians(15.0)
_LOG_DEPTH = math.log(1.1)

RESTART_OFFSETS: tuple[tuple[float, float], ...] = ((_TILT, 0.0), (-_TILT, 0.0), (0.0, _LOG_DEPTH), (0.0, -_LOG_DEPTH))
"""Start poses of the restarts: rotation about the camera's horizontal axis, radians, and change of log depth."""


def minimise_with_restarts(
    energy: JointEnergy, settings: JointSettings, progress: Progress | None = None
) -> MinimisationResult:
    """Minimise the joint energy from its present state, in place, with restarts for people with large errors.

    Late terms are added at the end, since they would keep apart people whose start is on the wrong side of each other.

    Args:
        energy: refreshed, and finite at its present state.
        progress: called with the completed share of the steps, 0-1.
    """
    origin = energy.state.pack()
    result = _minimise_from_starts(energy, settings, progress)
    groups = energy.add_late_terms()
    if groups is not None:
        late = settings.optimiser
        if isinstance(late, LbfgsSettings):
            late = replace(late, tolerance=min(late.tolerance, _LATE_TOLERANCE))
        result = join_results(energy, origin, result, minimise(energy, late, groups=groups))
    return result


def _minimise_from_starts(
    energy: JointEnergy, settings: JointSettings, progress: Progress | None
) -> MinimisationResult:
    """Minimise the energy, and restart people with large errors."""
    origin = energy.state.pack()
    first = _minimise_in_phases(energy, settings, progress)
    if settings.num_start_poses == 1 or not bool(_has_large_error(energy).any()):
        return first
    reached = energy.state.pack()
    energy.state.load(origin)
    energy.refresh()
    spent = select_start_poses(energy, settings)
    second = _minimise_in_phases(energy, settings, None)
    select_lowest_energy(energy, (reached, energy.state.pack()), refresh=True)
    with torch.no_grad():
        end = term_totals(energy())
    return replace(
        second,
        start=first.start,
        end=end,
        evaluations=first.evaluations + spent + second.evaluations,
        steps=first.steps + second.steps,
    )


def _minimise_in_phases(energy: JointEnergy, settings: JointSettings, progress: Progress | None) -> MinimisationResult:
    """Minimise from the present state, at first without the terms of the scene if the settings delay them."""
    optimiser = settings.optimiser
    first_steps = round(settings.scene_start_share * optimiser.steps)
    if not first_steps:
        return minimise(energy, optimiser, progress)
    origin = energy.state.pack()
    energy.excluded = _SCENE_TERMS
    share = first_steps / optimiser.steps
    first = minimise(energy, replace(optimiser, steps=first_steps), _subrange(progress, 0.0, share))
    energy.excluded = ()
    energy.refresh()
    rest = replace(optimiser, steps=optimiser.steps - first_steps)
    second = minimise(energy, rest, _subrange(progress, settings.scene_start_share, 1.0))
    final = energy.state.pack()
    energy.state.load(origin)
    with torch.no_grad():
        start = term_totals(energy())
    energy.state.load(final)
    return replace(
        second, start=start, evaluations=second.evaluations + first.evaluations, steps=second.steps + first.steps
    )


def select_start_poses(energy: JointEnergy, settings: JointSettings) -> int:
    """Set each person with a large reprojection error to the best of several start poses.

    Each start pose is optimised up to the first refresh, for all people in one run. The other people and the scene's
    scale keep the start by the body estimator. Returns the number of evaluations.
    """
    state = energy.state
    optimiser = settings.optimiser
    probe = replace(optimiser, steps=min(optimiser.refresh_steps, optimiser.steps))
    if isinstance(probe, LbfgsSettings):
        probe = replace(probe, tolerance=0.0)
    origin = state.pack()
    evaluations = minimise(energy, probe).evaluations
    energy.refresh()
    best, kept = _person_energies(energy), {group: value.detach().clone() for group, value in state.values.items()}
    doubtful = _has_large_error(energy)
    for tilt, log_depth in RESTART_OFFSETS[: settings.num_start_poses - 1] if bool(doubtful.any()) else ():
        state.load(origin)
        state.displace(doubtful, tilt, log_depth)
        energy.refresh()
        evaluations += minimise(energy, probe).evaluations
        energy.refresh()
        found = _person_energies(energy)
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
def _person_energies(energy: JointEnergy) -> Tensor:
    """Return the energy of each person (B,); inf where it is not finite."""
    return finite_energy_per_person(energy())


@torch.no_grad()
def _has_large_error(energy: JointEnergy) -> Tensor:
    """Return which people (B,) bool have a large mean reprojection error, or no confident keypoints."""
    context = energy.context
    error = energy.reprojection_errors(energy.state.unpack())
    confident = context.keypoints.confident.to(error.dtype)
    mean = (confident * error).sum(1) / confident.sum(1).clamp(min=1.0) / context.person_px
    return torch.where(confident.any(1), mean, torch.inf) >= RESTART_ERROR


def _subrange(progress: Progress | None, begin: float, end: float) -> Progress | None:
    """Return a progress callback that maps 0-1 to the interval from ``begin`` to ``end``."""
    return None if progress is None else lambda share: progress(begin + (end - begin) * share)
