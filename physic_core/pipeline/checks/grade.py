"""Overall grade of a person and of a photo, from their self-checks."""

from __future__ import annotations

from collections.abc import Sequence

from physic_core.pipeline.checks.specs import CHECKS
from physic_core.types import CheckResult, CheckState, Grade

__all__ = ["grade_person", "grade_photo"]

_WORST_FIRST = (Grade.BAD, Grade.DOUBTFUL, Grade.GOOD)


def grade_person(checks: Sequence[CheckResult], person: int) -> Grade:
    """Grade one person by the checks of this person.

    Bad if a backend gave no valid values or two checks contradict the body; doubtful if one does, if the evidence is
    weak, or if a check that the grade needs was not measured; good otherwise.
    """
    return _grade([check for check in checks if check.person == person])


def grade_photo(checks: Sequence[CheckResult], people: Sequence[Grade]) -> Grade:
    """Grade a photo: the worst of its people's grades and of its own checks.

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
