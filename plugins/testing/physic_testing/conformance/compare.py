"""Comparison of the accuracy of several backends of one interface on the same worlds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from physic_core.discovery.error_text import describe_error, traceback_text
from physic_core.errors import PhysicError
from physic_testing.conformance.accuracy import ERRORS, mean_errors, measure_errors
from physic_testing.conformance.backend_under_test import find_backend
from physic_testing.conformance.cases import SIZE, case_of_world
from physic_testing.conformance.expect import CheckSkipped
from physic_testing.conformance.report import finite_or_none
from physic_testing.conformance.tables import TABLES
from physic_testing.metrics.intervals import aligned_table
from physic_testing.worlds import load_world

if TYPE_CHECKING:
    from physic_core.interfaces import Backend
    from physic_testing.conformance.backend_under_test import BackendUnderTest, OptionsFor

DEFAULT_WORLDS = ("stand", "walk", "sit_on_chair", "group")
"""Names of the default worlds for the comparison of backends."""


@dataclass(frozen=True)
class BackendScores:
    """Mean errors and run time of one backend over the worlds.

    Attributes:
        backend: name of the backend.
        errors: error name with unit -> mean over the worlds with a valid result.
        completed: number of worlds with a valid result.
        seconds: median run time of ``infer`` on a loaded backend.
        problem: why the other worlds have no valid result; empty if all have one.
        traceback: traceback of the backend's errors if ``PHYSIC_DEBUG`` is set; else empty.
    """

    backend: str
    errors: dict[str, float]
    completed: int
    seconds: float
    problem: str = ""
    traceback: str = ""


@dataclass(frozen=True)
class BackendComparison:
    """Errors of several backends of one interface on the same worlds.

    Attributes:
        interface: interface of the backends.
        worlds: name of each world.
        size: width and height of the photos, px.
        rows: scores of each backend.
    """

    interface: str
    worlds: tuple[str, ...]
    size: tuple[int, int]
    rows: tuple[BackendScores, ...] = field(default=())

    @property
    def errors(self) -> list[str]:
        """Names of the errors that were measured of at least one backend."""
        return [name for name in ERRORS if any(name in row.errors for row in self.rows)]

    @property
    def text(self) -> str:
        """Table with one line per backend; * marks the best value of each column."""
        lines = [("backend", *self.errors, "s a photo", "worlds")]
        for row in self.rows:
            cells = [
                "-" if name not in row.errors else f"{row.errors[name]:.3g}{self._mark(row, name)}"
                for name in self.errors
            ]
            seconds = f"{row.seconds:.2f}" if row.completed else "-"
            lines.append((row.backend, *cells, seconds, f"{row.completed} of {len(self.worlds)}"))
        notes = [f"{row.backend}: {row.problem}" for row in self.rows if row.problem]
        notes += [row.traceback.rstrip("\n") for row in self.rows if row.traceback]
        width, height = self.size
        about = (
            f"{self.interface} on synthetic worlds of {width} x {height} px: "
            f"{', '.join(self.worlds)}; people, keypoints, bodies and "
            "hints that backends are given are the true ones; * is best"
        )
        return "\n".join([aligned_table(lines), *notes, about])

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison as a JSON-ready dict, NaN as None."""
        return {
            "interface": self.interface,
            "worlds": list(self.worlds),
            "size": list(self.size),
            "better": {name: ERRORS[name].better for name in self.errors},
            "backends": [
                {
                    "backend": row.backend,
                    "errors": finite_or_none(row.errors),
                    "answered": row.completed,
                    **finite_or_none({"seconds": row.seconds}),
                    "problem": row.problem,
                }
                for row in self.rows
            ],
        }

    def _mark(self, row: BackendScores, name: str) -> str:
        """Return a star if an error is the best of several backends."""
        values = [other.errors[name] for other in self.rows if name in other.errors]
        best = max if ERRORS[name].better == "higher" else min
        return "*" if len(values) > 1 and row.errors[name] == best(values) else ""


def compare(
    interface: str,
    backends: Sequence[str | type[Backend] | tuple[str | type[Backend], OptionsFor]],
    *,
    worlds: Sequence[str] = DEFAULT_WORLDS,
    device: str = "cpu",
    size: tuple[int, int] = SIZE,
) -> BackendComparison:
    """Measure the errors of several backends on the photos of the same worlds.

    Args:
        interface: interface of the backends.
        backends: names or classes, as for :func:`physic_testing.check_backend`, each alone or with
            its options.
        worlds: name of each world.
        device: device on which the backends are loaded.
        size: width and height of the photos, px.

    Raises:
        BackendError: a backend does not exist.
        ConfigError: a backend does not accept its options.
        InputError: a world does not exist.
    """
    subjects = []
    for entry in backends:
        backend, options = entry if isinstance(entry, tuple) else (entry, None)
        subject = find_backend(backend, interface, options=options, device=device, size=size)
        subject.table = TABLES.get(interface)
        if isinstance(options, Mapping) and options:
            settings = ", ".join(f"{key}={value}" for key, value in options.items())
            subject.name += f"{{{settings}}}"
        subjects.append(subject)
    scores = tuple(_scores(subject, worlds, size) for subject in subjects)
    return BackendComparison(interface, tuple(worlds), size, scores)


def _scores(
    subject: BackendUnderTest, worlds: Sequence[str], size: tuple[int, int]
) -> BackendScores:
    """Measure the mean errors and the median run time of one backend."""
    errors: list[Mapping[str, float]] = []
    seconds: list[float] = []
    problems: dict[str, str] = {}
    for name in worlds:
        case = case_of_world(name, load_world(name, size))
        try:
            attempt = subject.try_case(case)
            if attempt.error is not None:
                raise attempt.error
            seconds.append(attempt.seconds)
            problems |= dict.fromkeys(attempt.violations[:1], "")
            if not attempt.violations:
                errors.append(measure_errors(subject.table, attempt.result, case))
        except (Exception, SystemExit) as error:  # a plugin may raise any error
            cause = (isinstance(error, CheckSkipped) and error.__cause__) or error
            explained = isinstance(cause, CheckSkipped | PhysicError)
            words = str(error) if explained else describe_error(cause, subject.kind)
            problems[words] = traceback_text(cause)
    subject.close()
    return BackendScores(
        subject.name,
        mean_errors(errors),
        len(errors),
        sorted(seconds)[len(seconds) // 2] if seconds else math.nan,
        "; ".join(problems),
        "\n".join(filter(None, problems.values())),
    )
