"""Measure what each special rule of the engine is worth: the full model with and without it, on the same worlds.

    python -m benchmarks.rules run OUT --seed 2 --worlds 60 --jobs 2 [--only NAME,...]
    python -m benchmarks.rules table OUT [--level 99]
    python -m benchmarks.rules compare OUT OTHER [--level 99]

A row removes one rule by its settings. ``run`` keeps one JSON file a
world and row in OUT, and an interrupted run continues. ``table`` prints a Markdown table: the change of each figure by
the rule, full model minus row, with a bootstrap interval over worlds. A rule helps if F1 rises and errors fall.
``compare`` prints the full model of one version of the code minus that of another. The worlds have
the noise of version 4, other bodies, and labelled surfaces, as the embedded segmenter labels them.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

FIGURES = {
    "PA mm": "pa_mpjpe_mm",
    "MPJPE mm": "mpjpe_mm",
    "F1": "f1_of_means",
    "hidden limbs mm": "hidden_limbs_pa_mm",
    "support F1": "reported_support_f1",
    "people F1": "people_contact_f1",
    "self F1": "self_contact_f1",
    "floating mm": "true_floating_mm",
    "ECE": "ece",
}
"""Heading -> statistic of the benchmark."""


@dataclass(frozen=True)
class Rule:
    """One rule of the engine, and how a row goes without it.

    Attributes:
        name: of the row.
        figure: heading of :data:`FIGURES` that the rule exists for.
        settings: overrides of the engine's settings, as for ``physic bench accuracy --set``.
        contact_only: whether stages 1 to 3 are those of the full model.
    """

    name: str
    figure: str
    settings: tuple[str, ...] = ()
    contact_only: bool = False

    @property
    def joint_only(self) -> bool:
        """Whether stages 1 and 2 are those of the full model."""
        return all(text.startswith("joint.") for text in self.settings)


RULES = (
    Rule("depth term", "MPJPE mm", ("joint.depth.weight=0",)),
    Rule("occlusion awareness", "hidden limbs mm", ("joint.visibility.occlusion_aware=false",)),
    Rule("limits", "PA mm", ("joint.limits.weight=0",)),
    Rule("soles", "F1", ("joint.soles.weight=0",)),
    Rule("stature", "MPJPE mm", ("joint.stature.weight=0",)),
    Rule("free shape", "MPJPE mm", ('joint.frozen=["betas"]',)),
    Rule("people term", "people F1", ("joint.contact.people_weight=0", "joint.penetration.people_weight=0")),
    Rule("stance", "F1", ("placement.stance=false",)),
    Rule("skin contact", "self F1", ("contact.people=false",), contact_only=True),
    Rule("objects", "F1", ("contact.objects=false",), contact_only=True),
    Rule("hidden supports", "support F1", ("contact.assume_supports=false",), contact_only=True),
)
"""Every rule that can be removed alone."""

BASE = Rule("base", "F1", contact_only=False)


def main() -> int:
    """Run rows or print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.rules", description=(__doc__ or "").partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run")
    run.add_argument("out", type=Path)
    run.add_argument("--seed", type=int, required=True)
    run.add_argument("--worlds", type=int, default=60, help="of everyday and of contact actions each")
    run.add_argument("--jobs", type=int, default=1)
    run.add_argument("--only", default="", help="names of rules, with commas between them")
    run.add_argument("--without", default="", help="names of rules that every row goes without, the base too")
    table = commands.add_parser("table")
    table.add_argument("out", type=Path)
    table.add_argument("--level", type=float, default=99.0)
    compare = commands.add_parser("compare")
    compare.add_argument("out", type=Path)
    compare.add_argument("other", type=Path)
    compare.add_argument("--level", type=float, default=99.0)
    given = parser.parse_args()
    if given.command == "compare":
        print(comparison(given.out, given.other, given.level))
        return 0
    if given.command == "table":
        print(table_of(given.out, given.level))
        return 0
    names = [name.strip() for name in given.only.split(",") if name.strip()]
    chosen = [rule for rule in RULES if not names or rule.name in names]
    removed = [rule for rule in RULES if rule.name in given.without.split(",")]
    run_rows(given, chosen, removed)
    return 0


def run_rows(given: argparse.Namespace, chosen: Sequence[Rule], removed: Sequence[Rule]) -> None:
    """Run all rows of all worlds whose files are missing."""
    from physic_bench.worlds.world_evidence import benchmark_cases, with_other_bodies

    cases = with_other_bodies(benchmark_cases(given.worlds, given.seed, (320, 240), "both"))
    given.out.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        in_turn = sorted(range(len(cases)), key=lambda number: number % given.worlds)
        work = [pool.submit(run_case, i, cases[i], given.out, tuple(chosen), tuple(removed)) for i in in_turn]
        for done, future in enumerate(as_completed(work), 1):
            print(f"[{done}/{len(work)}] {future.result()}", file=sys.stderr, flush=True)


@cache
def _setup() -> tuple[Any, Any, Any]:
    import torch

    from physic_bench.worlds.evaluation import Evaluator
    from physic_core import load_config
    from physic_core.body import load_body
    from physic_core.configuration.resolve import resolve
    from physic_core.discovery.plugins import discover
    from physic_core.interfaces import INTERFACES

    torch.set_num_threads(1)
    mocks = {name: {"options": {"noise": 1}} for name in INTERFACES}
    mocks["segmenter"]["options"] |= {"surfaces": True}
    plan = resolve(load_config(preset="mock", flags={"noise": mocks}), discover())
    model = load_body(plan.body_model)
    return plan, model, Evaluator.body_graph(model)


def run_case(number: int, case: Any, out: Path, chosen: tuple[Rule, ...], removed: tuple[Rule, ...]) -> str:
    """Run the missing rows of one world; return a line about it."""
    from physic_bench.worlds.evaluation import Evaluator
    from physic_bench.worlds.world_evidence import estimate_evidence
    from physic_core.cache.folders import cache_folder
    from physic_core.files.strict_json import to_json
    from physic_testing.worlds import build_world

    files = {rule.name: out / f"{number:04d}-{rule.name.replace(' ', '_')}.json" for rule in (BASE, *chosen)}
    if all(file.exists() for file in files.values()):
        return f"{case.title}: done before"
    plan, model, skin = _setup()
    world = build_world(case.name, case.seed, case.size)
    evidence = estimate_evidence(case, world, plan, model, cache_folder("bench"))
    evaluator = Evaluator(world, evidence.people.masks, skin)
    kept = FullModel()
    for rule in (BASE, *chosen):
        if files[rule.name].exists() and rule is not BASE:
            continue
        record = {
            "name": case.name,
            "seed": case.seed,
            "people": evaluator.truth_records(),
            "false_alarms": len(evaluator.matching.false_alarms),
            "error": "",
            "row": run_row((rule, *removed), evidence, evaluator, model, kept),
        }
        files[rule.name].write_text(json.dumps(to_json(record, digits=7)))
    return case.title


class FullModel:
    """What the full model found in one world, for rows that share stages with it.

    Attributes:
        placed: results of stage 2, in the order of the calls.
        solved: result of stage 3, if it ran.
    """

    def __init__(self) -> None:
        self.placed: list[Any] = []
        self.solved: list[Any] = []


def run_row(rules: tuple[Rule, ...], evidence: Any, evaluator: Any, model: Any, kept: FullModel) -> dict[str, Any]:
    """Run the engine without ``rules`` and score it."""
    import torch

    from physic_bench.worlds.evaluation import engine_estimate
    from physic_core import load_config
    from physic_core.pipeline.optimise import run_engine
    from physic_core.pipeline.stage_runner import StageRunner

    overrides = [f"engine.{text}" for rule in rules for text in rule.settings]
    settings = load_config(preset="mock", overrides=overrides).engine.settings()
    torch.manual_seed(0)
    with _shared_stages(rules[0], kept):
        try:
            stages = StageRunner("cpu", 4)
            estimate = engine_estimate(run_engine(evidence, settings, model, stages))
            people, scene, error = evaluator.person_records(estimate), evaluator.scene_record(estimate), ""
        except Exception as cause:  # a row that fails in one world is counted
            error = f"{type(cause).__name__}: {cause}"
            people, scene = evaluator.missed_records(error), {}
    return {"people": people, "scene": scene, "seconds": None, "warnings": [], "error": error}


@contextmanager
def _shared_stages(rule: Rule, kept: FullModel) -> Iterator[None]:
    """Keep stages 2 and 3 of the full model, or use them in a row that shares them."""
    import physic_core.pipeline.optimise as engine

    place, solve = engine.solve_placement, engine.optimize
    with ExitStack() as stack:
        if rule is BASE:

            def placing(*args: Any, **named: Any) -> Any:
                kept.placed.append(place(*args, **named))
                return kept.placed[-1]

            def solving(*args: Any, **named: Any) -> Any:
                kept.solved[:] = [solve(*args, **named)]
                return kept.solved[0]

            stack.enter_context(patch.object(engine, "solve_placement", placing))
            stack.enter_context(patch.object(engine, "optimize", solving))
        elif rule.contact_only or rule.joint_only:
            placed = iter(kept.placed)
            stack.enter_context(patch.object(engine, "solve_placement", lambda *args, **named: next(placed)))
            if rule.contact_only:
                stack.enter_context(patch.object(engine, "optimize", lambda *args, **named: kept.solved[0]))
        yield


def table_of(out: Path, level: float) -> str:
    """Return the Markdown table of all rows, over the worlds that have the row and the base."""
    from physic_bench.worlds.summary import row_statistics

    heads = ["rule", "people changed", *FIGURES]
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    base_files = {file.name[:4]: file for file in sorted(out.glob("*-base.json"))}
    base = {key: json.loads(file.read_text()) for key, file in base_files.items()}
    records = [{**about, "rows": {"base": about["row"]}} for about in base.values()]
    full = row_statistics(records, "base")
    lines.append(
        f"| full model, {len(base)} worlds | | "
        + " | ".join(f"{full.figures[f].value:.4g}" for f in FIGURES.values())
        + " |"
    )
    for rule in RULES:
        rows = {
            file.name[:4]: json.loads(file.read_text()) for file in out.glob(f"*-{rule.name.replace(' ', '_')}.json")
        }
        both = [
            {**about, "rows": {"base": about["row"], "off": rows[key]["row"]}}
            for key, about in base.items()
            if key in rows
        ]
        if not both:
            continue
        on, off = row_statistics(both, "base"), row_statistics(both, "off")
        cells = []
        for head, name in FIGURES.items():
            spread = on.draws[name] - off.draws[name]
            low, high = np.nanpercentile(spread, [50 - level / 2, 50 + level / 2])
            change = on.figures[name].value - off.figures[name].value
            clear = "**" if low > 0 or high < 0 else ""
            cells.append(f"{clear}{change:+.3g}{clear} [{low:.2g}, {high:.2g}]" + (" *" if head == rule.figure else ""))
        changed = sum(
            a != b
            for record in both
            for a, b in zip(record["rows"]["base"]["people"], record["rows"]["off"]["people"], strict=True)
        )
        lines.append("| " + " | ".join([rule.name, str(changed), *cells]) + " |")
    return "\n".join(lines)


def comparison(out: Path, other: Path, level: float) -> str:
    """Return the Markdown table of the full model of two versions, and their paired difference."""
    from physic_bench.worlds.summary import row_statistics

    records = []
    for file in sorted(out.glob("*-base.json")):
        if (other / file.name).exists():
            about, before = json.loads(file.read_text()), json.loads((other / file.name).read_text())
            records.append({**about, "rows": {"now": about["row"], "before": before["row"]}})
    now, before = row_statistics(records, "now"), row_statistics(records, "before")
    lines = [
        f"| figure, {len(records)} worlds | before | now | difference, {level:g} % interval |",
        "|---|---|---|---|",
    ]
    for head, name in FIGURES.items():
        low, high = np.nanpercentile(now.draws[name] - before.draws[name], [50 - level / 2, 50 + level / 2])
        values = before.figures[name].value, now.figures[name].value
        lines.append(
            f"| {head} | {values[0]:.4g} | {values[1]:.4g} | {values[1] - values[0]:+.3g} [{low:.2g}, {high:.2g}] |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
