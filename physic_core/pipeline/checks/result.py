"""Results of checks: a value beside its threshold, the grade of a person and of a photo, and the warnings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from physic_core.pipeline.checks.specs import CHECKS
from physic_core.types import CheckResult, CheckState, Grade

_WORST_FIRST = (Grade.BAD, Grade.DOUBTFUL, Grade.GOOD)


def check_value(
    name: str,
    value: float | None,
    advice: str,
    *,
    unmeasured: str = "there is nothing to measure",
    failed: bool | None = None,
    threshold: float | None = None,
) -> CheckResult:
    """Compare a value with the threshold of its check.

    Args:
        name: of the check.
        value: None or NaN if nothing was measured.
        advice: the message if the check fails.
        unmeasured: the reason if there is no value.
        failed: decides instead of the comparison.
        threshold: replaces that of the check.
    """
    check = CHECKS[name]
    bound = check.threshold if threshold is None else threshold
    if value is None or math.isnan(value):
        state, message, value = CheckState.UNKNOWN, f"not measured: {unmeasured}", None
    else:
        if failed is None:
            failed = value < bound if check.direction == "at least" else value > bound
        state, value, message = CheckState.FAILED if failed else CheckState.OK, float(value), advice
    found = CheckResult(
        name,
        state,
        value,
        float(bound),
        check.direction,
        check.unit,
        message,
        label=check.label,
        share_of=check.share_of,
    )
    return replace(found, message=str(found)) if found.ok else found


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

    Bad if a backend gave no valid values or two checks contradict the body; doubtful if one does, if the evidence is
    weak, or if a check that the grade needs was not measured; good otherwise.
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


def measured(report: Mapping[str, Any], name: str) -> float | None:
    """Return a number of the engine's report on a person, or None if it is not there."""
    value = report.get(name)
    return None if value is None else float(value)


def relative_difference(ratio: float) -> float:
    """Return the share by which the larger of two numbers exceeds the smaller, from their ratio."""
    return math.exp(abs(math.log(ratio))) - 1
