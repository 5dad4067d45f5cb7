"""Schedule of the joint optimisation: terms between people are added at the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.optimiser import MinimisationResult, join_results
from physic_core.engine.joint.settings import LbfgsSettings, Progress
from physic_core.engine.joint.term import Term

__all__ = ["minimise_with_late_terms"]

_LATE_TOLERANCE = 1e-3
"""Tolerance of the steps with late terms, which are a small share of an energy that has converged."""


def minimise_with_late_terms(
    energy: JointEnergy, settings: LbfgsSettings, late: Sequence[Term], progress: Progress | None = None
) -> MinimisationResult:
    """Minimise the joint energy from its present state, in place; then add the late terms, and minimise again.

    From the start, terms between people would keep apart those who start on the wrong side of each other.

    Args:
        energy: refreshed, and finite at its present state.
        settings: of the optimiser.
        late: terms that are added if they are positive after the first steps.
        progress: called with the completed share of the steps, 0-1.
    """
    origin = energy.state.pack()
    result = settings.minimise(energy, progress)
    groups = energy.add_terms(late)
    if groups is None:
        return result
    settings = replace(settings, tolerance=min(settings.tolerance, _LATE_TOLERANCE))
    return join_results(energy, origin, result, settings.minimise(energy, groups=groups))
