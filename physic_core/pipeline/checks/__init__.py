"""Self-checks of a reconstruction: measured value, threshold, state, and advice for a failed check.

If nothing was measured, the value is None, the state "unknown", and the message says why. Names,
units and directions are stable. Each check is one function in ``photo`` or ``people``, with its
spec above it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.pipeline.checks import photo  # noqa: F401  # fills CHECKS
from physic_core.pipeline.checks.people import limb_keypoint_error
from physic_core.pipeline.checks.spec import (
    CHECKS,
    CheckSpec,
    failed_checks,
    unknown_checks,
    warning_messages,
)
from physic_core.pipeline.checks.trust import capped, no_trust, person_trust, photo_trust

if TYPE_CHECKING:
    from collections.abc import Iterable

    from physic_core.engine.state import Estimates
    from physic_core.types import CheckResult, Reconstruction

__all__ = [
    "CHECKS",
    "CheckSpec",
    "capped",
    "failed_checks",
    "limb_keypoint_error",
    "no_trust",
    "person_trust",
    "photo_trust",
    "run_checks",
    "unknown_checks",
    "warning_messages",
]


def run_checks(estimates: Estimates, result: Reconstruction) -> tuple[CheckResult, ...]:
    """Run all self-checks, first of the photo, then of each person, in the order of ``CHECKS``."""
    of_photo = (spec for spec in CHECKS.values() if spec.of == "photo")
    found = _measured((spec, spec.compare(spec.measure(estimates, result))) for spec in of_photo)
    for person in range(len(result.people)):
        of_person = (spec for spec in CHECKS.values() if spec.of == "person")
        found += _measured(
            (spec, spec.compare(spec.measure(estimates, result, person), person))
            for spec in of_person
        )
    return tuple(found)


def _measured(results: Iterable[tuple[CheckSpec, CheckResult]]) -> list[CheckResult]:
    """Return the results without those of optional checks for which nothing was measured."""
    return [result for spec, result in results if result.value is not None or not spec.optional]
