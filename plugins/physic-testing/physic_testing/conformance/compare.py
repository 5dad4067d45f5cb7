"""Two or more backends of one interface, tried on the same worlds: one table of their errors."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from physic_core.discovery.error_text import describe, traceback_text
from physic_core.errors import PhysicError
from physic_testing.conformance.accuracy import BETTER, mean_of, measure
from physic_testing.conformance.asking import form_faults, inputs
from physic_testing.conformance.cases import SIZE, case_of_world
from physic_testing.conformance.expect import CheckSkipped
from physic_testing.conformance.subject import find_subject
from physic_testing.worlds import build_world

if TYPE_CHECKING:
    from physic_core.discovery.registry import Registry
    from physic_core.interfaces import Backend
    from physic_testing.conformance.subject import OptionsFor, Subject

__all__ = ["COMPARED", "Comparison", "Row", "compare"]

COMPARED: tuple[tuple[str, int], ...] = (("stand", 0), ("walk", 0), ("sit_on_chair", 0), ("group", 0))
"""Name and seed of the worlds that backends are compared on unless others are named."""


@dataclass(frozen=True)
class Row:
    """One backend.

    Attributes:
        backend: its name.
        errors: means over the worlds that it answered, by name with the unit.
        answered: how many worlds it answered in the right form.
        seconds: median time of an answer, weights loaded.
        problem: why it did not answer the others; empty where it answered all.
        traceback: of what it raised, where ``PHYSIC_DEBUG`` asks for it; else empty.
    """

    backend: str
    errors: dict[str, float]
    answered: int
    seconds: float
    problem: str = ""
    traceback: str = ""


@dataclass(frozen=True)
class Comparison:
    """All backends.

    Attributes:
        interface: of all of them.
        worlds: name and seed of each.
        size: width and height of the photos, px.
        rows: one a backend.
    """

    interface: str
    worlds: tuple[tuple[str, int], ...]
    size: tuple[int, int]
    rows: tuple[Row, ...] = field(default=())

    @property
    def text(self) -> str:
        """A table: one line a backend, the best of each column marked *."""
        names = [name for name in BETTER if any(name in row.errors for row in self.rows)]
        head = ("backend", *names, "s a photo", "worlds")
        lines = [head]
        for row in self.rows:
            cells = [self._cell(row, name) for name in names]
            lines.append(
                (
                    row.backend,
                    *cells,
                    f"{row.seconds:.2f}" if row.answered else "-",
                    f"{row.answered} of {len(self.worlds)}",
                )
            )
        widths = [max(len(line[i]) for line in lines) for i in range(len(head))]
        table = ["  ".join(f"{cell:<{w}}" for cell, w in zip(line, widths, strict=True)).rstrip() for line in lines]
        notes = [f"{row.backend}: {row.problem}" for row in self.rows if row.problem]
        notes += [row.traceback.rstrip("\n") for row in self.rows if row.traceback]
        width, height = self.size
        worlds = ", ".join(f"{name} {seed}" for name, seed in self.worlds)
        about = (
            f"{self.interface} on synthetic worlds of {width} x {height} px: {worlds}; people, keypoints, bodies and "
            "hints that backends are given are the true ones; * is best"
        )
        return "\n".join([*table, *notes, about])

    def as_dict(self) -> dict[str, Any]:
        """For JSON: plain values, NaN as None."""
        return {
            "interface": self.interface,
            "worlds": [list(world) for world in self.worlds],
            "size": list(self.size),
            "better": {name: way for name, way in BETTER.items() if any(name in row.errors for row in self.rows)},
            "backends": [
                {
                    "backend": row.backend,
                    "errors": {name: value if math.isfinite(value) else None for name, value in row.errors.items()},
                    "answered": row.answered,
                    "seconds": row.seconds if math.isfinite(row.seconds) else None,
                    "problem": row.problem,
                }
                for row in self.rows
            ],
        }

    def _cell(self, row: Row, name: str) -> str:
        if name not in row.errors:
            return "-"
        values = [other.errors[name] for other in self.rows if name in other.errors]
        best = max(values) if BETTER[name] == "higher" else min(values)
        mark = "*" if len(values) > 1 and row.errors[name] == best else ""
        return f"{row.errors[name]:.3g}{mark}"


def compare(
    interface: str,
    backends: Sequence[str | type[Backend] | tuple[str | type[Backend], OptionsFor]],
    *,
    worlds: Sequence[tuple[str, int]] = COMPARED,
    registry: Registry | None = None,
    device: str = "cpu",
    size: tuple[int, int] = SIZE,
) -> Comparison:
    """Show the photos of worlds to several backends.

    Args:
        interface: of all of them.
        backends: names or classes, as for :func:`physic_testing.check_backend`, each alone or with its options.
        worlds: name and seed of each.
        registry: where names are looked up; None for everything installed.
        device: where backends are loaded.
        size: width and height of the photos, px.

    Raises:
        BackendError: one of the backends does not exist.
        ConfigError: options that a backend does not take.
        InputError: one of the worlds does not exist.
    """
    subjects = []
    for entry in backends:
        backend, options = entry if isinstance(entry, tuple) else (entry, None)
        subjects.append(find_subject(backend, interface, registry, options=options, device=device, size=size))
        if isinstance(options, Mapping) and options:
            subjects[-1].name += "{" + ", ".join(f"{key}={value}" for key, value in options.items()) + "}"
    rows = tuple(_row(subject, worlds, size) for subject in subjects)
    return Comparison(interface, tuple(worlds), size, rows)


def _row(subject: Subject, worlds: Sequence[tuple[str, int]], size: tuple[int, int]) -> Row:
    errors, times, problems, tracebacks = [], [], [], []
    for name, seed in worlds:
        case = case_of_world(f"{name} {seed}", build_world(name, seed, size))
        try:
            backend, arguments = subject.loaded(case), inputs(subject.interface, case)
            start = time.perf_counter()
            answer = subject.ask(backend, case, arguments)
            times.append(time.perf_counter() - start)
            faults = form_faults(subject.interface, answer, case)
            if faults:
                problems.append(faults[0])
            else:
                errors.append(measure(subject.interface, answer, case))
        except (Exception, SystemExit) as error:  # a plugin's door
            cause = error.__cause__ if isinstance(error, CheckSkipped) and error.__cause__ is not None else error
            said = isinstance(cause, (CheckSkipped, PhysicError))
            problems.append(str(error) if said else describe(cause, subject.kind))
            tracebacks.append(traceback_text(cause))
    subject.close()
    median = sorted(times)[len(times) // 2] if times else float("nan")
    return Row(
        subject.name,
        mean_of(errors),
        len(errors),
        median,
        "; ".join(dict.fromkeys(problems)),
        "\n".join(filter(None, tracebacks)),
    )
