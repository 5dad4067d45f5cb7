"""Registration of self-checks, their results, and warnings from the results."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

from physic_core.types import CheckResult, CheckState

YES = "1: yes"
"""Unit of a check that holds or not."""
NO_BODY = "this person has no body"
SIDE_VIEW = 'the view "From the side" in preview.png'
OTHER_BODY = "If the pose is wrong, do not use it, or replace it with --bodies FILE"

Measured = float | tuple[float | None, str] | None
"""Value of a check, None if nothing was measured; with a text in place of the check's advice, or of
its reason.
"""

_Check = TypeVar("_Check", bound=Callable[..., Measured])


@dataclass(frozen=True)
class CheckSpec:
    """One self-check.

    Attributes:
        name: as in :class:`physic_core.types.CheckResult`.
        label: the displayed name.
        direction: whether the value must be "at most" or "at least" the threshold.
        threshold: the bound.
        unit: of threshold and value.
        share_of: what a value of unit "share" is a share of; "" if the label says it.
        advice: the message if the check fails.
        unmeasured: the reason if there is no value.
        of: "photo" or "person".
        contradicts: marks of :data:`physic_core.types.MARKS` that a failure contradicts: it caps
            their probability.
        warns: whether a failed check is also a warning of the result.
        optional: whether the check is left out of a result for which nothing was measured.
        measure: of estimates and result, for a check of a person also of the person's index.
    """

    name: str
    label: str
    direction: Literal["at most", "at least"]
    threshold: float
    unit: str = "share"
    share_of: str = ""
    advice: str = ""
    unmeasured: str = "there is nothing to measure"
    of: Literal["photo", "person"] = "photo"
    contradicts: tuple[str, ...] = ()
    warns: bool = False
    optional: bool = False
    measure: Callable[..., Measured] = lambda *_: None

    def compare(self, measured: Measured, person: int | None = None) -> CheckResult:
        """Compare a value with the threshold; NaN counts as not measured."""
        value, text = measured if isinstance(measured, tuple) else (measured, "")
        if value is None or math.isnan(value):
            state = CheckState.UNKNOWN
            message = f"not measured: {text or self.unmeasured}"
            value = None
        else:
            failed = (
                value < self.threshold if self.direction == "at least" else value > self.threshold
            )
            state = CheckState.FAILED if failed else CheckState.OK
            message = text or self.advice
            value = float(value)
        result = CheckResult(
            self.name,
            state,
            value,
            float(self.threshold),
            self.direction,
            self.unit,
            message,
            person,
            label=self.label,
            share_of=self.share_of,
        )
        return replace(result, message=str(result)) if result.ok else result


CHECKS: dict[str, CheckSpec] = {}
"""Self-checks by name, in the order of the results."""


def check(
    of: Literal["photo", "person"],
    label: str,
    *,
    at_most: float | None = None,
    at_least: float | None = None,
    **spec: Any,
) -> Callable[[_Check], _Check]:
    """Register a function as the self-check of its name.

    Args:
        of: whether the function takes estimates and result, or also the index of a person.
        label: the displayed name.
        at_most: the largest value that is ok.
        at_least: the smallest value that is ok, if there is no largest.
        spec: other fields of :class:`CheckSpec`.
    """

    def register(measure: _Check) -> _Check:
        direction: Literal["at most", "at least"] = "at most" if at_least is None else "at least"
        threshold = at_most if at_least is None else at_least
        assert threshold is not None
        name = measure.__name__
        CHECKS[name] = CheckSpec(name, label, direction, threshold, of=of, measure=measure, **spec)
        return measure

    return register


def failed_checks(checks: Sequence[CheckResult], person: int) -> tuple[str, ...]:
    """Return the names of the failed self-checks of one person."""
    return tuple(check.name for check in checks if check.person == person and check.failed)


def unknown_checks(checks: Sequence[CheckResult], person: int) -> tuple[str, ...]:
    """Return the names of the self-checks of one person for which nothing was measured."""
    return tuple(
        check.name
        for check in checks
        if check.person == person and check.state is CheckState.UNKNOWN
    )


def warning_messages(checks: Sequence[CheckResult]) -> tuple[str, ...]:
    """Return the messages of the failed self-checks that have ``warns`` set."""
    return tuple(
        check.message if check.person is None else f"person {check.person}: {check.message}"
        for check in checks
        if check.failed and CHECKS[check.name].warns
    )
