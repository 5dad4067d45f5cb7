"""Execution of conformance checks on one backend: each check once, after the checks on which it
depends.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING

from physic_core.discovery.error_text import describe_error
from physic_core.errors import PhysicError
from physic_testing.conformance.accuracy import mean_accuracy
from physic_testing.conformance.expect import CheckFailed, CheckSkipped
from physic_testing.conformance.report import Report, Result

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.check import Check


class CheckRun:
    """Run of the checks of one backend; each check runs when its result is first requested.

    Args:
        subject: the backend under test.
        checks: checks in order of execution.
        expected_failures: name of a check -> why it is expected to fail.

    Raises:
        PhysicError: an expected failure is not the name of a check.
    """

    def __init__(
        self,
        subject: BackendUnderTest,
        checks: Sequence[Check],
        expected_failures: Mapping[str, str] | None = None,
    ) -> None:
        self.subject = subject
        self.checks = {check.name: check for check in checks}
        self._expected = dict(expected_failures or {})
        self._results: dict[str, Result] = {}
        require_check_names(self._expected, self.checks)

    def result(self, name: str) -> Result:
        """Return the result of a check; run it if needed."""
        if name not in self._results:
            start = time.perf_counter()
            found = self._run_check(self.checks[name])
            values = vars(found) | {"seconds": time.perf_counter() - start}
            self._results[name] = self._as_expected(Result(**values))
        return self._results[name]

    @property
    def not_run_reason(self) -> str:
        """Reason why the backend could not be called; empty if it was called."""
        form = self.result("returns_valid_output")
        return form.reason if form.outcome == "skipped" else ""

    def report(self, progress: Callable[[str, int, int], None] | None = None) -> Report:
        """Run the remaining checks, close the backend and return the report.

        Args:
            progress: called before each check with its name, the number of checks before it, and
                that of all.
        """
        results = []
        for done, name in enumerate(self.checks):
            if progress is not None:
                progress(name.replace("_", " "), done, len(self.checks))
            results.append(self.result(name))
        accuracy = mean_accuracy(self.subject)
        self.subject.close()
        subject = self.subject
        origin = "passed directly" if subject.claim is None else subject.claim.owner
        return Report(subject.interface, subject.name, origin, tuple(results), accuracy)

    def _run_check(self, check: Check) -> Result:
        """Run one check, or skip it because of a capability or an earlier failure."""
        name = check.name
        capabilities = self.subject.capabilities
        for word in sorted(check.unless & capabilities):
            return Result(name, "skipped", reason=f"the backend declares '{word}'")
        for word in sorted(check.only_with - capabilities):
            return Result(
                name, "skipped", reason=f"only for a backend with '{word}' in its capabilities"
            )
        for other in check.after:
            found = self.result(other)
            if found.outcome in ("failed", "xfailed"):
                return Result(name, "skipped", reason=f"see '{other}'")
            if found.outcome == "skipped" and found.reason.startswith("see '"):
                return Result(name, "skipped", reason=found.reason)
        try:
            with warnings.catch_warnings():
                # Warnings are not part of the contract; the caller's warning filters must not
                # affect a check.
                warnings.simplefilter("ignore")
                check.function(self.subject)
        except CheckFailed as failure:
            return Result(
                name,
                failure.outcome,
                failure.expected,
                failure.got,
                failure.hint,
                read=check.read,
                error=failure.__cause__,
            )
        except CheckSkipped as reason:
            return Result(name, "skipped", reason=str(reason))
        except Exception as error:
            got = describe_error(error, self.subject.kind)
            hint = "The check itself raised this error; it may be a defect of the check."
            return Result(
                name, "failed", check.summary.rstrip("."), got, hint, read=check.read, error=error
            )
        return Result(name, "passed")

    def _as_expected(self, result: Result) -> Result:
        """Mark a result as an expected failure or an unexpected success."""
        reason = self._expected.get(result.check)
        if reason is None or result.outcome == "skipped":
            return result
        outcome = "xfailed" if result.outcome == "failed" else "xpassed"
        return Result(**vars(result) | {"outcome": outcome, "reason": reason})


def require_check_names(names: Mapping[str, str], checks: Mapping[str, Check]) -> None:
    """Raise PhysicError if a name is not the name of a check.

    Raises:
        PhysicError: one is not.
    """
    for name in names:
        if name not in checks:
            close = get_close_matches(name, checks, n=1)
            hint = f"did you mean '{close[0]}'?" if close else f"valid are: {', '.join(checks)}"
            raise PhysicError(f"no check named '{name}' for this interface; {hint}")
