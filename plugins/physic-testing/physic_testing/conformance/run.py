"""Runs checks on one subject: each once, those that it builds on first."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING

from physic_core.discovery.error_text import describe
from physic_core.errors import PhysicError
from physic_testing.conformance.accuracy import accuracy_of
from physic_testing.conformance.expect import CheckFailed, CheckSkipped
from physic_testing.conformance.report import Report, Result

if TYPE_CHECKING:
    from physic_testing.conformance.check import Check
    from physic_testing.conformance.subject import Subject

__all__ = ["Run", "require_known"]


class Run:
    """The checks of one subject, each run when its result is first wanted.

    Args:
        subject: lets the backend be asked.
        checks: in order.
        expected_failures: name of a check -> why it is known to fail.

    Raises:
        PhysicError: an expected failure names no check.
    """

    def __init__(
        self, subject: Subject, checks: Sequence[Check], expected_failures: Mapping[str, str] | None = None
    ) -> None:
        self.subject, self.checks = subject, {check.name: check for check in checks}
        self._expected = dict(expected_failures or {})
        self._results: dict[str, Result] = {}
        require_known(self._expected, self.checks)

    def result(self, name: str) -> Result:
        """What came of a check."""
        if name not in self._results:
            start = time.perf_counter()
            found = self._judge(self.checks[name])
            values = vars(found) | {"seconds": time.perf_counter() - start}
            self._results[name] = self._as_expected(Result(**values))
        return self._results[name]

    @property
    def not_asked(self) -> str:
        """Why the backend could not be asked anything, empty where it was."""
        form = self.result("returns_valid_output")
        return form.reason if form.outcome == "skipped" else ""

    def report(self) -> Report:
        """Run whatever has not run yet, and close the backend."""
        results = tuple(self.result(name) for name in self.checks)
        accuracy = accuracy_of(self.subject)
        self.subject.close()
        subject = self.subject
        origin = "given by hand" if subject.claim is None else str(subject.claim.origin)
        return Report(subject.interface, subject.name, origin, results, accuracy)

    def _judge(self, check: Check) -> Result:
        name, capabilities = check.name, self.subject.capabilities
        for word in sorted(check.unless & capabilities):
            return Result(name, "skipped", reason=word)
        for word in sorted(check.only_with - capabilities):
            return Result(name, "skipped", reason=f"not {word}")
        for other in check.after:
            found = self.result(other)
            if found.outcome in ("failed", "xfailed"):
                return Result(name, "skipped", reason=f"see '{other}'")
            if found.outcome == "skipped" and found.reason.startswith("see '"):
                return Result(name, "skipped", reason=found.reason)
        try:
            with warnings.catch_warnings():
                # None of the contract's affairs, and must not decide by the settings of who runs the check.
                warnings.simplefilter("ignore")
                check.function(self.subject)
        except CheckFailed as failure:
            return Result(
                name,
                "failed",
                failure.expected,
                failure.got,
                failure.hint,
                read=check.read,
                error=failure.__cause__,
            )
        except CheckSkipped as reason:
            return Result(name, "skipped", reason=str(reason))
        except Exception as error:
            got = describe(error, self.subject.kind)
            hint = "The check itself stumbled."
            return Result(name, "failed", check.summary.rstrip("."), got, hint, read=check.read, error=error)
        return Result(name, "passed")

    def _as_expected(self, result: Result) -> Result:
        reason = self._expected.get(result.check)
        if reason is None or result.outcome == "skipped":
            return result
        outcome = "xfailed" if result.outcome == "failed" else "xpassed"
        return Result(**vars(result) | {"outcome": outcome, "reason": reason})


def require_known(names: Mapping[str, str], checks: Mapping[str, Check]) -> None:
    """Refuse names that are no checks.

    Raises:
        PhysicError: one is not.
    """
    for name in names:
        if name not in checks:
            close = get_close_matches(name, checks, n=1)
            hint = f"did you mean '{close[0]}'?" if close else f"there are: {', '.join(checks)}"
            raise PhysicError(f"no check named '{name}' for this interface; {hint}")
