"""Schedule of the joint optimisation: when terms of the scene and of several people are added."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch

from physic_core.engine.joint.acceptance import term_totals
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.optimiser import MinimisationResult, join_results, minimise
from physic_core.engine.joint.settings import JointSettings, LbfgsSettings

__all__ = ["minimise_with_schedule"]

_LATE_TOLERANCE = 1e-3
"""Tolerance of the steps with late terms, which are a small share of an energy that has converged."""

_SCENE_TERMS = ("contact", "penetration", "floor", "soles")

Progress = Callable[[float], None]


def minimise_with_schedule(
    energy: JointEnergy, settings: JointSettings, progress: Progress | None = None
) -> MinimisationResult:
    """Minimise the joint energy from its present state, in place.

    Late terms are added at the end, since they would keep apart people whose start is on the wrong side of each other.

    Args:
        energy: refreshed, and finite at its present state.
        progress: called with the completed share of the steps, 0-1.
    """
    origin = energy.state.pack()
    result = _minimise_in_phases(energy, settings, progress)
    groups = energy.add_late_terms()
    if groups is not None:
        late = settings.optimiser
        if isinstance(late, LbfgsSettings):
            late = replace(late, tolerance=min(late.tolerance, _LATE_TOLERANCE))
        result = join_results(energy, origin, result, minimise(energy, late, groups=groups))
    return result


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


def _subrange(progress: Progress | None, begin: float, end: float) -> Progress | None:
    """Return a progress callback that maps 0-1 to the interval from ``begin`` to ``end``."""
    return None if progress is None else lambda share: progress(begin + (end - begin) * share)
