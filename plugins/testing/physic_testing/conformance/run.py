"""Execution of conformance checks on one backend: each check once, after the checks on which it
depends.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from physic_core.cache import remember_passed
from physic_core.discovery.error_text import describe_error
from physic_core.interfaces import INTERFACES
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
    """

    def __init__(self, subject: BackendUnderTest, checks: Sequence[Check]) -> None:
        self.subject = subject
        self.checks = {check.name: check for check in checks}
        self._results: dict[str, Result] = {}

    def result(self, name: str) -> Result:
        """Return the result of a check; run it if needed."""
        if name not in self._results:
            start = time.perf_counter()
            result = self._run_check(self.checks[name])
            self._results[name] = replace(result, seconds=time.perf_counter() - start)
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
        self.finish()
        subject = self.subject
        origin = "passed directly" if subject.claim is None else subject.claim.owner
        return Report(subject.interface, subject.name, origin, tuple(results))

    def finish(self) -> None:
        """Close the backend, and remember that it passed, if all checks ran and none failed."""
        self.subject.close()
        is_whole = self._results.keys() == self.checks.keys() and not self.not_run_reason
        if is_whole and all(result.outcome != "failed" for result in self._results.values()):
            remember_passed(self.subject.interface, self.subject.construct())

    def _run_check(self, check: Check) -> Result:
        """Run one check, or skip it because of a capability or an earlier failure."""
        subject = self.subject
        if reason := self._reason_to_skip(check):
            return Result(check.name, "skipped", reason=reason)
        try:
            with warnings.catch_warnings():
                # Warnings are not part of the contract; the caller's warning filters must not
                # affect a check.
                warnings.simplefilter("ignore")
                check.function(subject)
            return Result(check.name, "passed")
        except CheckSkipped as skipped:
            return Result(check.name, "skipped", reason=str(skipped))
        except CheckFailed as failure:
            problem, error = failure, failure.__cause__
        except Exception as cause:
            hint = "The check itself raised this error; it may be a defect of the check."
            got = describe_error(cause, subject.kind)
            problem, error = CheckFailed(check.summary.rstrip("."), got, hint), cause
        read = check.read or f"physic_core.interfaces.{INTERFACES[subject.interface].__name__}"
        described = problem.outcome, problem.expected, problem.got, problem.hint
        return Result(check.name, *described, read=read, error=error)

    def _reason_to_skip(self, check: Check) -> str:
        """Return why a check cannot run; empty if it can."""
        for word in sorted(check.unless & self.subject.declared):
            return f"the backend declares '{word}'"
        for word in sorted(check.only_with - self.subject.declared):
            return f"only for a backend with '{word}' in its capabilities"
        for other in check.after:
            result = self.result(other)
            if result.outcome == "failed":
                return f"see '{other}'"
            if result.outcome == "skipped" and result.reason.startswith("see '"):
                return result.reason
        return ""
