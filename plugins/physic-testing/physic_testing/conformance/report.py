"""What came of the checks: counts, messages, JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from textwrap import shorten
from typing import Any, Literal

from physic_core.discovery.error_text import traceback_text

__all__ = ["OUTCOMES", "Outcome", "Report", "Result"]

Outcome = Literal["passed", "failed", "xfailed", "xpassed", "skipped"]
OUTCOMES: dict[Outcome, str] = {
    "passed": "passed",
    "failed": "failed",
    "xfailed": "failed as expected",
    "xpassed": "passed though expected to fail",
    "skipped": "skipped",
}
"""Outcome -> how the summary calls it."""


@dataclass(frozen=True)
class Result:
    """What came of one check.

    Attributes:
        check: its name.
        outcome: "xfailed" is an expected failure, "xpassed" one that did not happen, which is wrong too.
        expected: what the contract asks; of a failure.
        got: what came; of a failure.
        hint: what it may be; of a failure.
        reason: why it was skipped, or expected to fail.
        read: where to read more.
        seconds: time that it took, photos that it was the first to show included.
        error: what the backend raised, of a failure that comes of an exception.
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
        """Of what the backend raised, where ``PHYSIC_DEBUG`` asks for it; else empty."""
        return traceback_text(self.error).rstrip("\n")

    @property
    def message(self) -> str:
        """All there is to say about it."""
        if self.outcome == "failed":
            lines = [f"{self.check}", f"  expected: {self.expected}", f"  got:      {self.got}"]
            lines += [f"  hint:     {self.hint}"] if self.hint else []
            return "\n".join([*lines, f"  read:     {self.read}"])
        if self.outcome == "xpassed":
            return f"{self.check}\n  expected: a failure ({self.reason})\n  got:      it passes: expect it no longer"
        return f"{self.check}: {self.reason}" if self.reason else self.check


def _plain(result: Result) -> dict[str, Any]:
    """A result for JSON, with the traceback in place of the error."""
    values = {f.name: getattr(result, f.name) for f in fields(result) if f.name != "error"}
    return values | ({"traceback": result.traceback} if result.traceback else {})


@dataclass(frozen=True)
class Report:
    """What came of all checks of one backend.

    Attributes:
        interface: "metric_depth", ...
        backend: its name.
        origin: distribution and version, or how else it came here.
        results: one a check.
        accuracy: its errors on the worlds, by name with the unit; reported, never judged.
    """

    interface: str
    backend: str
    origin: str
    results: tuple[Result, ...]
    accuracy: Mapping[str, float] = field(default_factory=dict)

    @property
    def counts(self) -> dict[Outcome, int]:
        """Outcome -> how many."""
        return {outcome: sum(r.outcome == outcome for r in self.results) for outcome in OUTCOMES}

    @property
    def failures(self) -> tuple[Result, ...]:
        """The checks that failed, and those that passed though they were expected to fail."""
        return tuple(r for r in self.results if r.outcome in ("failed", "xpassed"))

    @property
    def not_asked(self) -> str:
        """Why the backend was never asked anything, empty where it was."""
        judged = {r.check: r for r in self.results if r.outcome != "skipped"}
        if not judged:
            return next((r.reason for r in self.results), "there was no check to run")
        form = next((r for r in self.results if r.check == "returns_valid_output"), None)
        return form.reason if form is not None and form.outcome == "skipped" else ""

    @property
    def ok(self) -> bool:
        """Whether nothing failed and something was asked: a run that judged nothing is no success."""
        return not self.failures and not self.not_asked

    @property
    def summary(self) -> str:
        """One line: "metric_depth:my-depth  23 checks: 21 passed, 2 skipped (stochastic 2)"."""
        reasons: dict[str, int] = {}
        for result in self.results:
            if result.outcome == "skipped":
                reasons[result.reason] = reasons.get(result.reason, 0) + 1
        words = [f"{count} {OUTCOMES[outcome]}" for outcome, count in self.counts.items() if count]
        if reasons and not self.not_asked:
            told = {shorten(reason, 90, placeholder=" ..."): n for reason, n in reasons.items()}
            words[-1] += f" ({'; '.join(f'{reason}: {n}' if n > 1 else reason for reason, n in told.items())})"
        line = f"{self.interface}:{self.backend}  {len(self.results)} checks: {', '.join(words) or 'none ran'}"
        return f"{line}\nNOTHING ASKED: {self.not_asked}" if self.not_asked else line

    @property
    def text(self) -> str:
        """Every failure, the accuracy, and the summary."""
        blocks = [text for r in self.failures for text in (r.message, r.traceback) if text]
        if self.accuracy:
            numbers = ", ".join(f"{name} {value:.3g}" for name, value in self.accuracy.items())
            blocks.append(f"accuracy on worlds (not judged): {numbers}")
        return "\n".join([*blocks, self.summary])

    def as_dict(self) -> dict[str, Any]:
        """For JSON: plain values, NaN as None."""
        numbers = {name: value if math.isfinite(value) else None for name, value in self.accuracy.items()}
        return {
            "interface": self.interface,
            "backend": self.backend,
            "origin": self.origin,
            "ok": self.ok,
            "not_asked": self.not_asked,
            "counts": self.counts,
            "results": [_plain(result) for result in self.results],
            "accuracy": numbers,
        }

    def raise_if_failed(self) -> None:
        """Turn a failure into an AssertionError with the whole text."""
        if not self.ok:
            raise AssertionError(self.text)
