"""Results of the conformance checks: counts, messages and JSON."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from textwrap import shorten
from typing import Any, Literal

from physic_core.discovery.error_text import traceback_text

Outcome = Literal["passed", "failed", "warned", "skipped"]
OUTCOMES: dict[Outcome, str] = {
    "passed": "passed",
    "failed": "failed",
    "warned": "warned of",
    "skipped": "skipped",
}
"""Outcome -> its text in the summary."""


@dataclass(frozen=True)
class Result:
    """Result of one check.

    Attributes:
        check: name of the check.
        outcome: "warned" is a failure of a check that only warns.
        expected: for a failure, the requirement.
        got: for a failure, the backend's output or error.
        hint: for a failure, a likely cause.
        reason: why the check was skipped.
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
        if not self.got:
            return f"{self.check}: {self.reason}" if self.reason else self.check
        title = f"warning: {self.check}" if self.outcome == "warned" else self.check
        lines = {name: getattr(self, name) for name in ("expected", "got", "hint", "read")}
        return "\n".join(
            [title, *(f"  {name + ':':9} {text}" for name, text in lines.items() if text)]
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the result as a JSON-ready dict, with the traceback instead of the error."""
        values = {name: value for name, value in vars(self).items() if name != "error"}
        return values | ({"traceback": self.traceback} if self.traceback else {})


@dataclass(frozen=True)
class Report:
    """Results of all checks of one backend.

    Attributes:
        interface: name of the interface, such as "metric_depth".
        backend: name of the backend.
        origin: distribution and version, or a note that the class was passed directly.
        results: one result per check.
    """

    interface: str
    backend: str
    origin: str
    results: tuple[Result, ...]

    @property
    def counts(self) -> dict[Outcome, int]:
        """Outcome -> number of checks."""
        return {outcome: sum(r.outcome == outcome for r in self.results) for outcome in OUTCOMES}

    @property
    def failures(self) -> tuple[Result, ...]:
        """Checks that failed."""
        return tuple(r for r in self.results if r.outcome == "failed")

    @property
    def warnings(self) -> tuple[Result, ...]:
        """What the contract does not forbid, but users would not want; ``ok`` does not depend on
        it.
        """
        return tuple(r for r in self.results if r.outcome == "warned")

    @property
    def not_run_reason(self) -> str:
        """Reason why the backend was never called; empty if it was called."""
        skipped = {r.check: r.reason for r in self.results if r.outcome == "skipped"}
        return skipped.get("returns_valid_output", "")

    @property
    def ok(self) -> bool:
        """Whether no check failed and the backend was called at least once."""
        return not self.failures and not self.not_run_reason

    @property
    def summary(self) -> str:
        """One line of counts, such as "metric_depth:my-depth  23 checks: 21 passed, 2 skipped
        (stochastic: 2)".
        """
        reasons = Counter(
            shorten(r.reason, 90, placeholder=" ...")
            for r in self.results
            if r.outcome == "skipped" and not self.not_run_reason
        )
        words = [f"{count} {OUTCOMES[outcome]}" for outcome, count in self.counts.items() if count]
        counted = [f"{reason}: {n}" if n > 1 else reason for reason, n in reasons.items()]
        why = f" ({'; '.join(counted)})" if counted else ""
        title = f"{self.interface}:{self.backend}  {len(self.results)} checks"
        return f"{title}: {', '.join(words)}{why}"

    @property
    def text(self) -> str:
        """All failures and warnings, and the summary as text."""
        bad = (*self.failures, *self.warnings)
        blocks = [text for r in bad for text in (r.message, r.traceback) if text]
        return "\n".join([*blocks, self.summary, self.verdict])

    @property
    def verdict(self) -> str:
        """One sentence: whether the backend passed, and what that leaves open."""
        names = ", ".join(r.check for r in self.failures or self.warnings)
        if self.failures:
            return f"failed: {names}"
        if self.not_run_reason:
            return f"BACKEND NEVER RUN: {self.not_run_reason}"
        warned = f"; {len(self.warnings)} warned: {names}" if names else ""
        return f"passed: {self.counts['passed']} checks{warned}"

    def as_dict(self) -> dict[str, Any]:
        """Return the report as a JSON-ready dict."""
        return {
            "interface": self.interface,
            "backend": self.backend,
            "origin": self.origin,
            "ok": self.ok,
            "not_asked": self.not_run_reason,
            "counts": self.counts,
            "results": [result.as_dict() for result in self.results],
        }

    def raise_if_failed(self) -> None:
        """Raise AssertionError with the full text if a check failed or the backend was never
        called.
        """
        if not self.ok:
            raise AssertionError(self.text)
