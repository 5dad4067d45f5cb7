"""Results of checks: a value beside its threshold, the grade of a person and of a photo, and the warnings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from physic_core.pipeline.checks.specs import CHECKS, CheckSpec
from physic_core.types import CheckResult, CheckState, Grade

_WORST_FIRST = (Grade.BAD, Grade.DOUBTFUL, Grade.GOOD)


@dataclass(frozen=True)
class Measurement:
    """Measurement of a check, before comparison with a threshold.

    Attributes:
        name: of the check.
        value: None or NaN if nothing was measured.
        advice: the message if the check fails.
        unmeasured: the reason if there is no value.
        failed: overrides the comparison.
        threshold: replaces that of the check.
    """

    name: str
    value: float | None
    advice: str
    unmeasured: str = "there is nothing to measure"
    failed: bool | None = None
    threshold: float | None = None


def compare_with_threshold(found: Measurement, person: int | None = None, spec: CheckSpec | None = None) -> CheckResult:
    """Compare a measurement with the threshold of its check.

    Args:
        found: the measurement.
        person: None for a check of the photo.
        spec: of a check of a plugin.
    """
    check, value = spec or CHECKS[found.name], found.value
    bound = check.threshold if found.threshold is None else found.threshold
    if value is None or math.isnan(value):
        state, message, value = CheckState.UNKNOWN, f"not measured: {found.unmeasured}", None
    else:
        beyond = value < bound if check.direction == "at least" else value > bound
        failed = beyond if found.failed is None else found.failed
        state, value, message = CheckState.FAILED if failed else CheckState.OK, float(value), found.advice
    result = CheckResult(
        found.name,
        state,
        value,
        float(bound),
        check.direction,
        check.unit,
        message,
        person,
        label=check.label,
        share_of=check.share_of,
    )
    return replace(result, message=str(result)) if result.ok else result


def failed_checks(checks: Sequence[CheckResult], person: int) -> tuple[str, ...]:
    """Return the names of the failed self-checks of one person."""
    return tuple(check.name for check in checks if check.person == person and check.failed)


def unknown_checks(checks: Sequence[CheckResult], person: int) -> tuple[str, ...]:
    """Return the names of the self-checks of one person for which nothing was measured."""
    return tuple(check.name for check in checks if check.person == person and check.state is CheckState.UNKNOWN)


def warning_messages(checks: Sequence[CheckResult]) -> tuple[str, ...]:
    """Return the messages of the failed self-checks that have ``warns`` set."""
    return tuple(
        check.message if check.person is None else f"person {check.person}: {check.message}"
        for check in checks
        if check.failed and CHECKS[check.name].warns
    )


def grade_person(checks: Sequence[CheckResult], person: int) -> Grade:
    """Grade one person by the checks of this person.

    Bad if a backend returned no valid values or two checks contradict the body; doubtful if one does, if the evidence
    is weak, or if a check that the grade needs was not measured; good otherwise.
    """
    return _grade([check for check in checks if check.person == person])


def grade_photo(checks: Sequence[CheckResult], people: Sequence[Grade]) -> Grade:
    """Grade a photo: the worst of the grades of its main people and of its own checks.

    Without people it is at best doubtful: nothing confirms the scale.
    """
    grades = {*(people or [Grade.DOUBTFUL]), _grade([check for check in checks if check.person is None])}
    return next(grade for grade in _WORST_FIRST if grade in grades)


def _grade(checks: Sequence[CheckResult]) -> Grade:
    failures = [CHECKS[check.name].failure for check in checks if check.failed]
    if "bad" in failures or failures.count("contradiction") > 1:
        return Grade.BAD
    unknown = any(CHECKS[check.name].needed for check in checks if check.state is CheckState.UNKNOWN)
    return Grade.DOUBTFUL if unknown or set(failures) - {"ignored"} else Grade.GOOD


def relative_difference(ratio: float) -> float:
    """Return the share by which the larger of two numbers exceeds the smaller, from their ratio."""
    return math.exp(abs(math.log(ratio))) - 1
