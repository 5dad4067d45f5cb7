"""Compare preset "paper" with the ablation table of the paper, by the signs of the differences between rows.

    python -m benchmarks.table3 run OUT --seed 2 --worlds 48 [--noise-version 3] [--size 320x240] [--readings NAME,...]
    python -m benchmarks.table3 table OUT [--readings NAME,...] [--eps-cm 3]
    python -m benchmarks.table3 eps OUT [--readings NAME,...]

A reading is a choice that the paper leaves open, as overrides of the preset's settings. ``run`` computes every row of
every reading, and keeps one JSON file a world in OUT; an interrupted run continues. Rows with the same settings of
stages 1 and 2 share these stages. ``table`` prints the rows, and for each figure and step from one row to the next
whether its sign agrees with the paper: a difference within its paired 95 % interval over worlds is undecided. ``eps``
prints precision, recall and F1 of the full model by the bound of the contact map. The worlds have everyday actions and
people of the body model.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest.mock import patch

FIGURES = {"PA": "pa_mpjpe_mm", "MPJPE": "mpjpe_mm", "F1": "f1_of_means"}
"""Heading -> statistic of the benchmark."""

READINGS: Mapping[str, tuple[str, ...]] = {
    "sum-1": ("joint.reprojection.reduction=sum", "joint.regularisation.visible_weight=1"),
    "sum-0": ("joint.reprojection.reduction=sum", "joint.regularisation.visible_weight=0"),
    "mean-1": ("joint.reprojection.reduction=mean", "joint.regularisation.visible_weight=1"),
    "mean-0": ("joint.reprojection.reduction=mean", "joint.regularisation.visible_weight=0"),
}
"""Name -> overrides: L_j2d as a sum or a mean over keypoints, and the weight of visible vertices in L_reg."""

EPS_CM = (1, 1.5, 2, 2.5, 3, 3.5, 4, 5, 6, 8)
"""Bounds eps_c of the contact map that are tried, cm."""

_SHARED = ("solve_scene", "solve_placement")
_ENGINE = "physic_core.pipeline.optimise"


def main() -> int:
    """Run rows or print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.table3", description=(__doc__ or "").partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    run, table, eps = (commands.add_parser(name) for name in ("run", "table", "eps"))
    run.add_argument("out", type=Path)
    run.add_argument("--seed", type=int, required=True)
    run.add_argument("--worlds", type=int, default=48)
    run.add_argument("--noise-version", type=int, default=3)
    run.add_argument("--size", default="320x240", help="of the photos, px")
    run.add_argument("--only-full", action="store_true", help="of each reading the full model alone")
    table.add_argument("--eps-cm", type=float, choices=EPS_CM, help="instead of the preset's")
    for command in (table, eps):
        command.add_argument("out", type=Path)
        command.add_argument("--worlds", type=int, help="how many of them are read; all by default")
    for command in (run, table, eps):
        command.add_argument("--readings", default="", help="names, with commas between them; all by default")
    given = parser.parse_args()
    from physic_bench.worlds.ablation import ABLATION
    from physic_bench.worlds.world_evidence import benchmark_cases

    names = [name.strip() for name in given.readings.split(",") if name.strip()] or list(READINGS)
    if unknown := set(names) - set(READINGS):
        parser.error(f"no reading named {', '.join(sorted(unknown))}; there are: {', '.join(READINGS)}")
    if given.command == "run":
        width, height = map(int, given.size.split("x"))
        cases = benchmark_cases(given.worlds, given.seed, (width, height))
        steps = ABLATION[5:6] if given.only_full else ABLATION[:6]
        run_worlds(given.out, cases, given.noise_version, names, steps)
        return 0
    records = read(given.out, names, given.worlds)
    print(eps_table(records, names) if given.command == "eps" else sign_table(records, names, given.eps_cm))
    return 0


def run_worlds(
    out: Path, cases: Sequence[Any], noise_version: int, readings: Sequence[str], steps: Sequence[Any]
) -> None:
    """Compute the rows that are missing in the files of ``out``."""
    out.mkdir(parents=True, exist_ok=True)
    for number, case in enumerate(cases):
        file = out / f"{number:04d}.json"
        record = json.loads(file.read_text()) if file.exists() else {"rows": {}}
        missing = [name for name in readings if f"{name}/full" not in record["rows"]]
        if missing or "start" not in record["rows"]:
            record = run_case(case, noise_version, missing, steps, record["rows"])
            file.write_text(json.dumps(record))
        print(
            f"[{number + 1}/{len(cases)}] {case.title}: {', '.join(missing) or 'done before'}",
            file=sys.stderr,
            flush=True,
        )


@cache
def _setup(noise_version: int) -> tuple[Any, Any, Any]:
    import torch

    from physic_bench.worlds.evaluation import Evaluator
    from physic_core import load_config
    from physic_core.body import load_body
    from physic_core.configuration.resolve import resolve
    from physic_core.discovery.plugins import discover
    from physic_core.interfaces import PHOTO_INTERFACES

    torch.set_num_threads(1)
    noise = {name: {"options": {"version": noise_version}} for name in PHOTO_INTERFACES}
    plan = resolve(load_config(preset="mock", flags={"--noise-version": noise}), discover())
    model = load_body(plan.body_model)
    return plan, model, Evaluator.body_graph(model)


def run_case(
    case: Any, noise_version: int, readings: Sequence[str], steps: Sequence[Any], rows: dict[str, Any]
) -> dict[str, Any]:
    """Return the record of a world: ``rows`` with the start and the ``steps`` of ``readings`` added."""
    from physic_bench.worlds.evaluation import Evaluator, engine_estimate, initial_estimate
    from physic_bench.worlds.table_rows import ablation_rows
    from physic_bench.worlds.world_evidence import cache_folder, estimate_evidence
    from physic_core import load_config
    from physic_core.pipeline.optimise import run_engine
    from physic_core.pipeline.stage_runner import StageRunner
    from physic_testing.worlds import build_world

    plan, model, skin = _setup(noise_version)
    world = build_world(case.name, case.seed, case.size)
    evidence = estimate_evidence(case, world, plan, model, cache_folder())
    evaluator = Evaluator(world, evidence.people.masks, skin)
    rows = {**rows, "start": _row(evaluator, initial_estimate(evidence, model, 0.5), None)}
    of_label = {row.label: row.key for row in ablation_rows("paper")}
    remembered: dict[Any, Any] = {}
    for reading in readings:
        overrides = [f"engine.{text}" for text in ("preset=paper", *READINGS[reading])]
        full = load_config(preset="mock", overrides=overrides).engine.settings()
        for step in steps:
            settings = step.settings(full)
            with shared_stages(remembered, (settings.scene, settings.placement)):
                solution = run_engine(evidence, settings, model, StageRunner("cpu", 4))
            rows[f"{reading}/{of_label[step.name]}"] = _row(evaluator, engine_estimate(solution), solution)
    about = {"name": case.name, "seed": case.seed, "people": evaluator.truth_records(), "error": ""}
    return {**about, "false_alarms": len(evaluator.matching.false_alarms), "rows": rows}


@contextmanager
def shared_stages(remembered: dict[Any, Any], settings: Any) -> Iterator[None]:
    """Let stages 1 and 2 return what they returned before under the same settings."""

    def memo(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        calls = iter(range(100))

        def call(*args: Any, **kwargs: Any) -> Any:
            key = (name, repr(settings), next(calls))
            if key not in remembered:
                remembered[key] = function(*args, **kwargs)
            return remembered[key]

        return call

    import physic_core.pipeline.optimise as engine

    with ExitStack() as stack:
        for name in _SHARED:
            stack.enter_context(patch(f"{_ENGINE}.{name}", memo(name, getattr(engine, name))))
        yield


def _row(evaluator: Any, estimate: Any, solution: Any | None) -> dict[str, Any]:
    """Return the figures of each true person; by eps_c too, if there is a solution."""
    import numpy as np

    kept = ("found", "why", "pa_mpjpe_mm", "mpjpe_mm", "precision", "recall", "f1", "hits", "false_alarms", "misses")
    people = [{name: p.get(name) for name in kept} for p in evaluator.person_records(estimate)]
    row: dict[str, Any] = {"people": people, "scene": {}, "seconds": None, "error": ""}
    if solution is None:
        return row
    found, true = evaluator.matching.predicted, evaluator.matching.truth
    near, fact = np.abs(solution.distance[found]), evaluator.world.contact[true]
    near[:, ~_setup_outer()] = np.inf
    for i, person in enumerate(true):
        people[person]["by_eps"] = [_scores(near[i] <= 0.01 * eps, fact[i]) for eps in EPS_CM]
    losses = solution.diagnostics["joint"]["losses"]
    return {**row, "losses": {name: value["end"] for name, value in losses.items()}}


@cache
def _setup_outer() -> Any:
    from physic_core.body import load_body

    return load_body("embedded").outer.numpy()


def _scores(predicted: Any, fact: Any) -> tuple[float, float]:
    hits = float((predicted & fact).sum())
    return hits / max(float(predicted.sum()), 1.0), hits / max(float(fact.sum()), 1.0)


def read(out: Path, readings: Sequence[str], worlds: int | None) -> list[dict[str, Any]]:
    """Return the records of the worlds that have the rows of all readings."""
    records = [json.loads(file.read_text()) for file in sorted(out.glob("*.json"))[:worlds]]
    return [record for record in records if all(f"{name}/full" in record["rows"] for name in readings)]


def with_eps(records: Sequence[Mapping[str, Any]], eps_cm: float) -> None:
    """Replace the contact scores of all rows that have a scene by those of a bound."""
    k = EPS_CM.index(eps_cm)
    for person in (p for record in records for row in record["rows"].values() for p in row["people"]):
        if "by_eps" in person:
            person["precision"], person["recall"] = person["by_eps"][k]


def sign_table(records: Sequence[Mapping[str, Any]], readings: Sequence[str], eps_cm: float | None = None) -> str:
    """Return the Markdown tables of rows and of signs."""
    from physic_bench.worlds.paper_results import PAPER_RESULTS
    from physic_bench.worlds.summary import row_difference, row_statistics

    if eps_cm is not None:
        with_eps(records, eps_cm)
    keys = ["start", "reprojection", "contact", "penetration", "depth", "occlusion", "full"]
    lines = [f"{len(records)} worlds, {sum(len(r['people']) for r in records)} people", ""]
    lines += ["| row | the paper | " + " | ".join(readings) + " |", "|---|---|" + "---|" * len(readings)]
    rows = {
        (name, key): row_statistics(records, key if key == "start" else f"{name}/{key}")
        for name in readings
        for key in keys
    }
    for key in keys:
        cells = [" / ".join(_number(head, getattr(PAPER_RESULTS[key], name)) for head, name in FIGURES.items())]
        for reading in readings:
            figures = rows[reading, key].figures
            cells.append(" / ".join(_number(head, figures[name].value) for head, name in FIGURES.items()))
        lines.append(f"| {key} | " + " | ".join(cells) + " |")
    lines += ["", "| step, figure | the paper | " + " | ".join(readings) + " |", "|---|---|" + "---|" * len(readings)]
    counts = {name: {mark: [0, 0] for mark in ("agree", "disagree", "undecided")} for name in readings}
    for before, after in pairwise(keys):
        for head, name in FIGURES.items():
            printed = getattr(PAPER_RESULTS[after], name) - getattr(PAPER_RESULTS[before], name)
            cells = [_number(head, printed, "+")]
            for reading in readings:
                change = row_difference(rows[reading, after], rows[reading, before], name)
                mark = "undecided"
                if change.low > 0 or change.high < 0:
                    mark = "agree" if change.value * printed > 0 else "disagree"
                counts[reading][mark][0] += 1
                counts[reading][mark][1] += before != "start"
                half = (change.high - change.low) / 2
                sign = {"agree": "=", "disagree": "**x**", "undecided": "?"}[mark]
                cells.append(f"{_number(head, change.value, '+')} ±{_number(head, half)} {sign}")
            lines.append(f"| {before} -> {after}, {head} | " + " | ".join(cells) + " |")
    for mark in ("agree", "disagree", "undecided"):
        cells = [f"{counts[name][mark][0]} ({counts[name][mark][1]})" for name in readings]
        lines.append(f"| {mark} (without the start) | | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _number(head: str, value: float, sign: str = "") -> str:
    return format(value, f"{sign}.3f" if head == "F1" else f"{sign}.1f")


def eps_table(records: Sequence[Mapping[str, Any]], readings: Sequence[str]) -> str:
    """Return a Markdown table: precision, recall and F1 of the full model by eps_c; missed people count 0."""
    import numpy as np

    lines = ["| eps_c cm | " + " | ".join(readings) + " |", "|---|" + "---|" * len(readings)]
    for k, eps in enumerate(EPS_CM):
        cells = []
        for name in readings:
            people = [person for record in records for person in record["rows"][f"{name}/full"]["people"]]
            p, r = np.mean([person["by_eps"][k] if "by_eps" in person else (0.0, 0.0) for person in people], axis=0)
            cells.append(f"{p:.3f} / {r:.3f} / {2 * p * r / max(p + r, 1e-9):.3f}")
        lines.append(f"| {eps:g} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
