"""Results of the conformance checks: counts, messages and JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from textwrap import shorten
from typing import Any, Literal

from physic_core.discovery.error_text import traceback_text

Outcome = Literal["passed", "failed", "warned", "xfailed", "xpassed", "skipped"]
OUTCOMES: dict[Outcome, str] = {
    "passed": "passed",
    "failed": "failed",
    "warned": "warned of",
    "xfailed": "failed as expected",
    "xpassed": "passed though expected to fail",
    "skipped": "skipped",
}
"""Outcome -> its text in the summary."""


@dataclass(frozen=True)
class Result:
    """Result of one check.

    Attributes:
        check: name of the check.
        outcome: "warned" is a failure of a check that only warns; "xfailed" is an expected failure;
            "xpassed" is an unexpected success, which counts as a failure.
        expected: for a failure, the requirement.
        got: for a failure, the backend's output or error.
        hint: for a failure, a likely cause.
        reason: why the check was skipped or is expected to fail.
        read: module or class that documents the requirement.
        seconds: run time, including the first call of the backend on each photo.
        error: for a failure caused by an exception, the exception.
    """

    check: str
    outcome: Outcome
    expected: str = ""
    got: str = ""
    hint: str = ""
    reason: str = ""
    read: str = ""
    seconds: float = 0.0
    error: BaseException | None = field(default=None, compare=False, repr=False)

    @property
    def traceback(self) -> str:
        """Traceback of the backend's error if ``PHYSIC_DEBUG`` is set; else empty."""
        return traceback_text(self.error).rstrip("\n")

    @property
    def message(self) -> str:
        """Name of the check with its failure, or with its reason for being skipped."""
        if self.outcome in ("failed", "warned"):
            title = f"warning: {self.check}" if self.outcome == "warned" else self.check
            lines = [title, f"  expected: {self.expected}", f"  got:      {self.got}"]
            lines += [f"  hint:     {self.hint}"] if self.hint else []
            return "\n".join([*lines, f"  read:     {self.read}"])
        if self.outcome == "xpassed":
            lines = [self.check, f"  expected: a failure ({self.reason})"]
            return "\n".join([*lines, "  got:      it passes: remove it from expected_failures"])
        return f"{self.check}: {self.reason}" if self.reason else self.check


def _plain(result: Result) -> dict[str, Any]:
    """Return a result as a JSON-ready dict, with the traceback instead of the error."""
    values = {f.name: getattr(result, f.name) for f in fields(result) if f.name != "error"}
    return values | ({"traceback": result.traceback} if result.traceback else {})


@dataclass(frozen=True)
class Report:
    """Results of all checks of one backend.

    Attributes:
        interface: name of the interface, such as "metric_depth".
        backend: name of the backend.
        origin: distribution and version, or a note that the class was passed directly.
        results: one result per check.
        accuracy: error name with unit -> mean error on the worlds; no check depends on it.
    """

    interface: str
    backend: str
    origin: str
    results: tuple[Result, ...]
    accuracy: Mapping[str, float] = field(default_factory=dict)

    @property
    def counts(self) -> dict[Outcome, int]:
        """Outcome -> number of checks."""
        return {outcome: sum(r.outcome == outcome for r in self.results) for outcome in OUTCOMES}

    @property
    def failures(self) -> tuple[Result, ...]:
        """Checks that failed, and checks that passed although a failure was expected."""
        return tuple(r for r in self.results if r.outcome in ("failed", "xpassed"))

    @property
    def warnings(self) -> tuple[Result, ...]:
        """What the contract does not forbid, but users would not want; ``ok`` does not depend on
        it.
        """
        return tuple(r for r in self.results if r.outcome == "warned")

    @property
    def not_run_reason(self) -> str:
        """Reason why the backend was never called; empty if it was called."""
        judged = {r.check: r for r in self.results if r.outcome != "skipped"}
        if not judged:
            return next((r.reason for r in self.results), "there was no check to run")
        form = next((r for r in self.results if r.check == "returns_valid_output"), None)
        return form.reason if form is not None and form.outcome == "skipped" else ""

    @property
    def ok(self) -> bool:
        """Whether no check failed and the backend was called at least once."""
        return not self.failures and not self.not_run_reason

    @property
    def summary(self) -> str:
        """One line of counts, such as "metric_depth:my-depth  23 checks: 21 passed, 2 skipped
        (stochastic 2)".
        """
        reasons: dict[str, int] = {}
        for result in self.results:
            if result.outcome == "skipped":
                reasons[result.reason] = reasons.get(result.reason, 0) + 1
        words = [f"{count} {OUTCOMES[outcome]}" for outcome, count in self.counts.items() if count]
        if reasons and not self.not_run_reason:
            shortened = {
                shorten(reason, 90, placeholder=" ..."): n for reason, n in reasons.items()
            }
            counted = (f"{reason}: {n}" if n > 1 else reason for reason, n in shortened.items())
            words[-1] += f" ({'; '.join(counted)})"
        return (
            f"{self.interface}:{self.backend}  {len(self.results)} checks: "
            f"{', '.join(words) or 'none ran'}"
        )

    @property
    def text(self) -> str:
        """All failures and warnings, the accuracy, and the summary as text."""
        blocks = [
            text
            for r in (*self.failures, *self.warnings)
            for text in (r.message, r.traceback)
            if text
        ]
        if self.accuracy:
            numbers = ", ".join(f"{name} {value:.3g}" for name, value in self.accuracy.items())
            blocks.append(f"mean errors on synthetic photos, which no check judges: {numbers}")
        return "\n".join([*blocks, self.summary, self.verdict])

    @property
    def verdict(self) -> str:
        """One sentence: whether the backend passed, and what that leaves open."""
        if self.failures:
            return f"failed: {', '.join(r.check for r in self.failures)}"
        if self.not_run_reason:
            return f"BACKEND NEVER RUN: {self.not_run_reason}"
        words = [f"passed: {self.counts['passed']} checks"]
        if self.warnings:
            names = ", ".join(result.check for result in self.warnings)
            words.append(f"{len(self.warnings)} warned: {names}")
        return "; ".join(words)

    def as_dict(self) -> dict[str, Any]:
        """Return the report as a JSON-ready dict, NaN as None."""
        numbers = {
            name: value if math.isfinite(value) else None for name, value in self.accuracy.items()
        }
        return {
            "interface": self.interface,
            "backend": self.backend,
            "origin": self.origin,
            "ok": self.ok,
            "not_asked": self.not_run_reason,
            "counts": self.counts,
            "results": [_plain(result) for result in self.results],
            "accuracy": numbers,
        }

    def raise_if_failed(self) -> None:
        """Raise AssertionError with the full text if a check failed or the backend was never
        called.
        """
        if not self.ok:
            raise AssertionError(self.text)
