"""Speed of the engine, as run-time ratios measured in one run (``physic bench speed``).

Stage 3 is solved in float64, as in a run.

Seconds depend on the machine and its load. The compared variants are therefore run in turns in each round, and a ratio
is the median of the rounds' ratios, so that load affects both sides.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

from physic_core.errors import ConfigError

if TYPE_CHECKING:
    from physic_core.engine.joint.method import JointMethod
    from physic_core.engine.joint.problem import JointProblem

SECTIONS: Mapping[str, str] = {
    "floor": "Stage 3 against 100 forward and backward passes of the body model in float32, one person",
    "people": "Stage 3 by people in the photo",
}
"""Section -> what it measures."""

PASSES = 100
"""Number of passes of the body model."""


@dataclass(frozen=True)
class SpeedRow:
    """Run time of one variant.

    Attributes:
        section: key of :data:`SECTIONS`.
        name: name of the variant.
        seconds: median over the rounds.
        ratio: median ratio to the first row of its section.
        numbers: other numbers: people, evaluations, errors in mm.
    """

    section: str
    name: str
    seconds: float
    ratio: float
    numbers: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SpeedReport:
    """Results of :func:`measure_speed`.

    Attributes:
        machine: device, cores, threads and versions.
        preset: engine preset.
        seed: seed of the problems.
        repeats: number of rounds.
        rows: rows in order of measurement.
    """

    machine: Mapping[str, str | int]
    preset: str
    seed: int
    repeats: int
    rows: tuple[SpeedRow, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return the report as a JSON-ready dict."""
        return asdict(self)

    def row(self, section: str, name: str) -> SpeedRow:
        """Return the row with the given section and name.

        Raises:
            KeyError: it was not measured.
        """
        for row in self.rows:
            if (row.section, row.name) == (section, name):
                return row
        raise KeyError(f"{section}: {name}")


def measure_speed(
    repeats: int = 5,
    *,
    sections: Sequence[str] = tuple(SECTIONS),
    people: Sequence[int] = (1, 2, 4, 8),
    size: tuple[int, int] = (640, 480),
    preset: str = "default",
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> SpeedReport:
    """Measure run times: minutes for all sections, seconds for one.

    Args:
        repeats: number of rounds; medians are taken over them.
        sections: keys of :data:`SECTIONS`.
        people: numbers of people of the section "people"; the first is the reference.
        size: width and height of the photos, px.
        preset: engine preset.
        seed: seed of the problems.
        progress: called with each section before it is measured.

    Raises:
        ConfigError: a section or preset does not exist, or ``repeats`` is below 1.
    """
    from physic_core import engine_preset
    from physic_core.adapters.threads import limited_threads
    from physic_core.body import load_body

    _check(repeats, sections, people)
    bench = _SpeedBenchmark(load_body("embedded"), engine_preset(preset).joint, repeats, size, seed)
    rows: list[SpeedRow] = []
    with limited_threads():  # as the pipeline does
        for section in sections:
            if progress is not None:
                progress(SECTIONS[section])
            rows += bench.floor() if section == "floor" else bench.people(people)
    return SpeedReport(_machine(), preset, seed, repeats, tuple(rows))


def format_report(report: SpeedReport) -> str:
    """Format the report as text, one table per section."""
    machine = report.machine
    lines = [
        f"{machine['processor']}, {machine['cores']} cores, torch {machine['torch']}, CUDA: {machine['cuda']}",
        f"preset {report.preset!r}, seed {report.seed}, medians of {report.repeats} rounds",
    ]
    for section in dict.fromkeys(row.section for row in report.rows):
        rows = [row for row in report.rows if row.section == section]
        width = max(len(row.name) for row in rows)
        lines += ["", SECTIONS[section]]
        for row in rows:
            counted = ", ".join(f"{name} {_number(value)}" for name, value in row.numbers.items())
            lines.append(
                f"  {row.name:<{width}}  {_seconds(row.seconds):>9}  {_ratio(row.ratio):>8}  {counted}".rstrip()
            )
    return "\n".join(lines)


@dataclass(frozen=True)
class _SpeedBenchmark:
    """Measurements of all sections for one body model and settings."""

    model: Any
    settings: JointMethod
    repeats: int
    size: tuple[int, int]
    seed: int

    def floor(self) -> list[SpeedRow]:
        """Compare stage 3 with forward and backward passes of the body model."""
        import torch

        problem, counts = self._problem(), _SolverCounts()
        start = (problem.rotations0, problem.betas0, problem.transl0)
        inputs = [tensor.to(self.model.dtype, copy=True).requires_grad_() for tensor in start]

        def passes() -> None:
            for _ in range(PASSES):
                torch.autograd.grad(self.model(*inputs).vertices.sum(), inputs)

        runs = {f"{PASSES} passes": passes, "stage 3": lambda: counts.solve(problem, self.settings)}
        return self._rows("floor", runs, {"stage 3": counts})

    def people(self, numbers: Sequence[int]) -> list[SpeedRow]:
        """Compare stage 3 by number of people."""
        problems = {f"{n} people" if n > 1 else "1 person": self._problem(n) for n in numbers}
        counts = {name: _SolverCounts() for name in problems}
        runs = {
            name: lambda problem=problem, name=name: counts[name].solve(problem, self.settings)
            for name, problem in problems.items()
        }
        return self._rows("people", runs, counts)

    def _problem(self, people: int = 1) -> JointProblem:
        """Build a problem in float64 with the benchmark's size and seed."""
        import torch

        from physic_bench.worlds.synthetic_problems import make_joint_problem

        problem = make_joint_problem(self.model, people, self.size, self.seed)
        return replace(problem, model=self.model.to(dtype=torch.float64)).to_model_dtype()

    def _rows(
        self, section: str, runs: Mapping[str, Callable[[], None]], counts: Mapping[str, _SolverCounts]
    ) -> list[SpeedRow]:
        """Measure several functions and return their rows."""
        timed = _time_in_turns(runs, self.repeats)
        return [
            SpeedRow(section, name, seconds, ratio, counts[name].numbers if name in counts else {})
            for name, (seconds, ratio) in timed.items()
        ]


class _SolverCounts:
    """Number of evaluations and steps of an optimisation."""

    def __init__(self) -> None:
        self.numbers: dict[str, float] = {}

    def solve(self, problem: JointProblem, settings: JointMethod) -> None:
        """Solve a problem and store the counts."""
        from physic_core.engine.joint.solve import optimize

        result = optimize(problem, settings)
        self.numbers = {"evaluations": result.evaluations, "steps": result.steps}


def _time_in_turns(runs: Mapping[str, Callable[[], None]], repeats: int) -> dict[str, tuple[float, float]]:
    """Run functions in turns; return median seconds and median ratio to the first. One warm-up round."""
    times: dict[str, list[float]] = {name: [] for name in runs}
    for turn in range(repeats + 1):
        for name, run in runs.items():
            start = time.perf_counter()
            run()
            if turn:
                times[name].append(time.perf_counter() - start)
    base = times[next(iter(runs))]
    return {
        name: (statistics.median(spent), statistics.median(s / b for s, b in zip(spent, base, strict=True)))
        for name, spent in times.items()
    }


def _check(repeats: int, sections: Sequence[str], people: Sequence[int]) -> None:
    """Raise ConfigError for invalid arguments."""
    if repeats < 1:
        raise ConfigError(f"at least one round is needed, got {repeats}")
    if unknown := [name for name in sections if name not in SECTIONS]:
        raise ConfigError(f"no section named {unknown[0]!r}: choose among {', '.join(SECTIONS)}")
    if not people or not all(1 <= n <= 8 for n in people):
        raise ConfigError("people must be numbers from 1 to 8, at least one")


def _machine() -> dict[str, str | int]:
    """Return processor, cores and versions of this machine."""
    import platform

    import torch

    cuda = torch.cuda.get_device_name() if torch.cuda.is_available() else "none"
    return {
        "processor": _processor() or platform.machine(),
        "cores": _cores(),
        "python": platform.python_version(),
        "torch": torch.__version__,
        "cuda": cuda,
    }


def _cores() -> int:
    """Return the number of available cores."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _processor() -> str:
    """Return the name of the processor; empty if unknown."""
    import platform

    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "")
    except OSError:
        return platform.processor()


def _number(value: float) -> str:
    return f"{value:.0f}" if float(value).is_integer() else f"{value:.3g}"


def _seconds(value: float) -> str:
    return f"{value:.2f} s" if value >= 1 else f"{1e3 * value:.0f} ms"


def _ratio(value: float) -> str:
    if value == 1:
        return "1"
    return f"x {value:.2f}" if value > 0.1 else f"1 / {1 / value:.0f}"
