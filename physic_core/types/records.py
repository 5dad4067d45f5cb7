"""Records of a run: backends, stages with their times, and results of self-checks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal

__all__ = ["CheckResult", "CheckState", "Grade", "Provenance", "StageRecord", "summarize_checks"]


@dataclass(frozen=True)
class Provenance:
    """Backend, plugin and options that produced a result.

    ``plugin`` is the import name of the plugin, ``version`` that of its ``distribution``.
    """

    interface: str
    backend: str
    plugin: str
    distribution: str
    version: str
    options: Mapping[str, Any]
    weights_license: str


@dataclass(frozen=True)
class StageRecord:
    """Name, times and backend of one stage of a run.

    Attributes:
        name: as in the progress bar.
        seconds: without loading weights.
        load_seconds: time to load weights.
        provenance: the backend, or None for a stage of the engine.
        cached: whether the result was read from the cache; the backend was then neither loaded nor called.
        failed: whether the backend failed; an optional backend's failure does not end the run.
    """

    name: str
    seconds: float
    load_seconds: float = 0.0
    provenance: Provenance | None = None
    cached: bool = False
    failed: bool = False


class CheckState(StrEnum):
    """Outcome of a self-check."""

    OK = "ok"
    """The value was measured and is within the threshold."""

    FAILED = "failed"
    """The value was measured and is beyond the threshold."""

    UNKNOWN = "unknown"
    """Nothing was measured; the message says why."""


class Grade(StrEnum):
    """How far a result can be trusted, by its self-checks; docs/checks.md says how often each grade is right."""

    GOOD = "good"
    """All checks that the grade needs were measured and are ok."""

    DOUBTFUL = "doubtful"
    """A check failed, or one that the grade needs was not measured."""

    BAD = "bad"
    """The checks contradict the result."""


@dataclass(frozen=True)
class CheckResult:
    """Result of one self-check of a reconstruction; :mod:`physic_core.pipeline.checks` lists all checks.

    Attributes:
        name: of the check; stable, so that results can be filtered by it.
        state: a :class:`CheckState` or its value.
        value: the measured number, or None if nothing was measured.
        threshold: the bound on ``value``.
        direction: whether ``value`` must be "at most" or "at least" the threshold.
        unit: of value and threshold.
        message: meaning of the value; what to do if the check failed; the reason if nothing was measured.
        person: index into ``Reconstruction.people``, or None if the check is about the photo.
    """

    name: str
    state: CheckState
    value: float | None
    threshold: float
    direction: Literal["at most", "at least"]
    unit: str
    message: str
    person: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "state", CheckState(self.state))

    @property
    def ok(self) -> bool:
        """Whether the value was measured and is within the threshold."""
        return self.state is CheckState.OK

    @property
    def failed(self) -> bool:
        """Whether the value was measured and is beyond the threshold."""
        return self.state is CheckState.FAILED


def summarize_checks(checks: Sequence[CheckResult]) -> str:
    """Return how many checks failed, were not measured, and are ok: "2 failed, 3 not measured, 24 ok"."""
    if not checks:
        return "no checks were run"
    count = Counter(check.state for check in checks)
    parts = [f"{count[CheckState.FAILED]} failed"] * bool(count[CheckState.FAILED])
    parts += [f"{count[CheckState.UNKNOWN]} not measured"] * bool(count[CheckState.UNKNOWN])
    return ", ".join([*parts, f"{count[CheckState.OK]} ok"])
