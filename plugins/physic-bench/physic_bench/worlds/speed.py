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
    "nearest": "Nearest scene points of all vertices, 100 steps with their set-up",
    "people": "Stage 3 by people in the photo",
    "size": "Stage 3 by the photo's resolution, one person",
    "threads": "Stage 3 by threads of torch, one person",
    "cuda": "Stage 3 on CUDA against the CPU",
}
"""Section -> what it measures."""

PASSES = 100  # of the body model, and queries of nearest points
"""Number of body model passes, and of nearest-point queries."""
_SIZES = {"240p": (320, 240), "480p": (640, 480), "720p": (1280, 720), "1080p": (1920, 1080)}


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
        notes: skipped measurements, with the reason.
    """

    machine: Mapping[str, str | int]
    preset: str
    seed: int
    repeats: int
    rows: tuple[SpeedRow, ...]
    notes: tuple[str, ...] = ()

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
    sizes: Sequence[str] = tuple(_SIZES),
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
        sizes: "240p", "480p", "720p", "1080p"; the first is the reference.
        size: width and height of all other photos, px.
        preset: engine preset.
        seed: seed of the problems.
        progress: called with each section before it is measured.

    Raises:
        ConfigError: a section, size or preset does not exist, or ``repeats`` is below 1.
    """
    from physic_core import engine_preset
    from physic_core.adapters.threads import limited_threads
    from physic_core.body import load_body

    _check(repeats, sections, sizes, people)
    bench = _SpeedBenchmark(load_body("embedded"), engine_preset(preset).joint, repeats, size, seed)
    measures: dict[str, Callable[[], tuple[list[SpeedRow], list[str]]]] = {
        "floor": bench.floor,
        "nearest": bench.nearest,
        "people": lambda: bench.people(people),
        "size": lambda: bench.sizes(sizes),
        "threads": bench.threads,
        "cuda": bench.cuda,
    }
    rows: list[SpeedRow] = []
    notes: list[str] = []
    # As the pipeline runs it.
    with limited_threads():
        for section in sections:
            if progress is not None:
                progress(SECTIONS[section])
            new_rows, new_notes = measures[section]()
            rows += new_rows
            notes += new_notes
    return SpeedReport(_machine(), preset, seed, repeats, tuple(rows), tuple(notes))


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
    lines += ["", *report.notes] if report.notes else []
    return "\n".join(lines)


@dataclass(frozen=True)
class _SpeedBenchmark:
    """Measurements of all sections for one body model and settings."""

    model: Any
    settings: JointMethod
    repeats: int
    size: tuple[int, int]
    seed: int

    def floor(self) -> tuple[list[SpeedRow], list[str]]:
        """Compare stage 3 with forward and backward passes of the body model."""
        import torch

        problem, counts = self._problem(), _SolverCounts()
        start = (problem.rotations0, problem.betas0, problem.transl0)
        inputs = [tensor.to(self.model.dtype, copy=True).requires_grad_() for tensor in start]

        def passes() -> None:
            for _ in range(PASSES):
                torch.autograd.grad(self.model(*inputs).vertices.sum(), inputs)

        runs = {f"{PASSES} passes": passes, "stage 3": lambda: counts.solve(problem, self.settings)}
        return self._rows("floor", runs, {"stage 3": counts}), []

    def nearest(self) -> tuple[list[SpeedRow], list[str]]:
        """Compare strategies for nearest scene points."""
        from physic_bench.worlds.speed_nearest import nearest_rows

        rows = nearest_rows(self._problem(), PASSES, self.repeats, _time_in_turns)
        return [SpeedRow("nearest", *row) for row in rows], [
            "nearest: the plain search is timed on some of the vertices, and its time multiplied."
        ]

    def people(self, counts: Sequence[int]) -> tuple[list[SpeedRow], list[str]]:
        """Compare stage 3 by number of people."""
        return self._compare("people", {f"{n} people" if n > 1 else "1 person": self._problem(n) for n in counts})

    def sizes(self, names: Sequence[str]) -> tuple[list[SpeedRow], list[str]]:
        """Compare stage 3 by resolution."""
        return self._compare("size", {name: self._problem(size=_SIZES[name]) for name in names})

    def threads(self) -> tuple[list[SpeedRow], list[str]]:
        """Compare stage 3 by number of threads."""
        from physic_core.adapters.threads import limited_threads

        problem = self._problem()

        def run(threads: int) -> None:
            with limited_threads(threads):
                _solve(problem, self.settings)

        counts = [n for n in (1, 2, 4, 8, 16) if n <= _cores()]
        runs = {f"{n} threads" if n > 1 else "1 thread": lambda n=n: run(n) for n in counts}
        return self._rows("threads", runs, {}), []

    def cuda(self) -> tuple[list[SpeedRow], list[str]]:
        """Compare stage 3 on CUDA and CPU."""
        import torch

        if not torch.cuda.is_available():
            return [], ["CUDA: there is none on this machine, so it was not measured."]
        here = self._problem()
        there = replace(here, model=here.model.to("cuda")).to_model_dtype()

        def on_device() -> None:
            _solve(there, self.settings)
            torch.cuda.synchronize()

        def on_cpu() -> None:
            _solve(here, self.settings)

        runs = {"CPU": on_cpu, "CUDA": on_device}
        return self._rows("cuda", runs, {}), []

    def _problem(self, people: int = 1, size: tuple[int, int] | None = None) -> JointProblem:
        """Build a problem in float64 with the benchmark's size and seed."""
        import torch

        from physic_bench.worlds.synthetic_problems import make_joint_problem

        problem = make_joint_problem(self.model, people, self.size if size is None else size, self.seed)
        return replace(problem, model=self.model.to(dtype=torch.float64)).to_model_dtype()

    def _compare(self, section: str, problems: Mapping[str, JointProblem]) -> tuple[list[SpeedRow], list[str]]:
        """Measure stage 3 on several problems."""
        counts = {name: _SolverCounts() for name in problems}
        runs = {
            name: lambda problem=problem, name=name: counts[name].solve(problem, self.settings)
            for name, problem in problems.items()
        }
        return self._rows(section, runs, counts), []

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
        evaluations, steps = _solve(problem, settings)
        self.numbers = {"evaluations": evaluations, "steps": steps}


def _solve(problem: JointProblem, settings: JointMethod) -> tuple[int, int]:
    """Solve a problem; return evaluations and steps."""
    from physic_core.engine.joint.solve import optimize

    result = optimize(problem, settings)
    return result.evaluations, result.steps


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


def _check(repeats: int, sections: Sequence[str], sizes: Sequence[str], people: Sequence[int]) -> None:
    """Raise ConfigError for invalid arguments."""
    if repeats < 1:
        raise ConfigError(f"at least one round is needed, got {repeats}")
    for what, given, known in (("section", sections, SECTIONS), ("size", sizes, _SIZES)):
        unknown = [name for name in given if name not in known]
        if unknown:
            raise ConfigError(f"no {what} named {unknown[0]!r}: choose among {', '.join(known)}")
    if not people or not sizes or not all(1 <= n <= 8 for n in people):
        raise ConfigError("people must be numbers from 1 to 8 and sizes names, at least one of each")


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
