"""Comparison of the accuracy of several backends of one interface on the same worlds."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from physic_core.discovery.error_text import describe_error, traceback_text
from physic_core.errors import PhysicError
from physic_core.metrics.intervals import aligned_table
from physic_testing.conformance.accuracy import ERRORS, mean_errors, measure_errors
from physic_testing.conformance.backend_under_test import find_backend
from physic_testing.conformance.cases import SIZE, case_of_world
from physic_testing.conformance.contract import case_violations
from physic_testing.conformance.expect import CheckSkipped
from physic_testing.conformance.requests import infer_arguments
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
    def text(self) -> str:
        """Table with one line per backend; * marks the best value of each column."""
        names = [name for name in ERRORS if any(name in row.errors for row in self.rows)]
        head = ("backend", *names, "s a photo", "worlds")
        lines = [head]
        for row in self.rows:
            cells = [self._cell(row, name) for name in names]
            lines.append(
                (
                    row.backend,
                    *cells,
                    f"{row.seconds:.2f}" if row.completed else "-",
                    f"{row.completed} of {len(self.worlds)}",
                )
            )
        notes = [f"{row.backend}: {row.problem}" for row in self.rows if row.problem]
        notes += [row.traceback.rstrip("\n") for row in self.rows if row.traceback]
        width, height = self.size
        worlds = ", ".join(self.worlds)
        about = (
            f"{self.interface} on synthetic worlds of {width} x {height} px: {worlds}; people, "
            f"keypoints, bodies and "
            "hints that backends are given are the true ones; * is best"
        )
        return "\n".join([aligned_table(lines), *notes, about])

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison as a JSON-ready dict, NaN as None."""
        return {
            "interface": self.interface,
            "worlds": list(self.worlds),
            "size": list(self.size),
            "better": {
                name: error.better
                for name, error in ERRORS.items()
                if any(name in row.errors for row in self.rows)
            },
            "backends": [
                {
                    "backend": row.backend,
                    "errors": {
                        name: value if math.isfinite(value) else None
                        for name, value in row.errors.items()
                    },
                    "answered": row.completed,
                    "seconds": row.seconds if math.isfinite(row.seconds) else None,
                    "problem": row.problem,
                }
                for row in self.rows
            ],
        }

    def _cell(self, row: BackendScores, name: str) -> str:
        """Format one error; * marks the best of several backends."""
        if name not in row.errors:
            return "-"
        values = [other.errors[name] for other in self.rows if name in other.errors]
        best = max(values) if ERRORS[name].better == "higher" else min(values)
        mark = "*" if len(values) > 1 and row.errors[name] == best else ""
        return f"{row.errors[name]:.3g}{mark}"


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
        subjects.append(find_backend(backend, interface, options=options, device=device, size=size))
        if isinstance(options, Mapping) and options:
            subjects[-1].name += (
                "{" + ", ".join(f"{key}={value}" for key, value in options.items()) + "}"
            )
    rows = tuple(_row(subject, worlds, size) for subject in subjects)
    return BackendComparison(interface, tuple(worlds), size, rows)


def _row(subject: BackendUnderTest, worlds: Sequence[str], size: tuple[int, int]) -> BackendScores:
    """Measure the mean errors and the median run time of one backend."""
    errors = []
    times = []
    problems = []
    tracebacks = []
    for name in worlds:
        case = case_of_world(name, load_world(name, size))
        try:
            backend = subject.loaded(case)
            arguments = infer_arguments(subject.interface, case)
            start = time.perf_counter()
            answer = subject.infer(backend, case, arguments)
            times.append(time.perf_counter() - start)
            faults = case_violations(subject.interface, answer, case)
            if faults:
                problems.append(faults[0])
            else:
                errors.append(measure_errors(subject.interface, answer, case))
        except (Exception, SystemExit) as error:  # a plugin may raise any error
            cause = (
                error.__cause__
                if isinstance(error, CheckSkipped) and error.__cause__ is not None
                else error
            )
            explained = isinstance(cause, (CheckSkipped, PhysicError))
            problems.append(str(error) if explained else describe_error(cause, subject.kind))
            tracebacks.append(traceback_text(cause))
    subject.close()
    median = sorted(times)[len(times) // 2] if times else float("nan")
    return BackendScores(
        subject.name,
        mean_errors(errors),
        len(errors),
        median,
        "; ".join(dict.fromkeys(problems)),
        "\n".join(filter(None, tracebacks)),
    )
