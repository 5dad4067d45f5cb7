"""Self-checks of a reconstruction: measured value, threshold, state, and advice for a failed check.

If nothing was measured, the value is None, the state "unknown", and the message says why. Names, units and directions
are stable; the thresholds of ``floor``, ``scene_alignment`` and ``photo_alignment`` follow the engine's settings.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.pipeline.checks.person import check_person
from physic_core.pipeline.checks.photo import check_photo
from physic_core.pipeline.checks.result import (
    compare_with_threshold,
    failed_checks,
    grade_person,
    grade_photo,
    unknown_checks,
    warning_messages,
)
from physic_core.pipeline.checks.specs import CHECKS, CheckSpec

if TYPE_CHECKING:
    from physic_core.engine.settings import EngineSettings
    from physic_core.pipeline.estimate import Estimates
    from physic_core.pipeline.solution import Solution
    from physic_core.types import CheckResult

__all__ = [
    "CHECKS",
    "CheckSpec",
    "failed_checks",
    "grade_person",
    "grade_photo",
    "run_checks",
    "unknown_checks",
    "warning_messages",
]


def run_checks(estimates: Estimates, solution: Solution, settings: EngineSettings) -> tuple[CheckResult, ...]:
    """Run all self-checks, first of the photo, then of each person, in the order of ``CHECKS``."""
    found = [compare_with_threshold(one) for one in check_photo(estimates, solution, settings)]
    for person in range(len(solution.people)):
        found += [compare_with_threshold(one, person) for one in check_person(estimates, solution, person)]
    return tuple(found)
