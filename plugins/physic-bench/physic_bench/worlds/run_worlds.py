"""Execution of the accuracy benchmark: estimators once per world, then the engine once per table
row.

Each process computes one world at a time. Estimates and rows are kept by a hash of their inputs and
source code, so that an interrupted run, or a run with another row, reuses them.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import cache, partial
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_bench.kept import kept
from physic_bench.worlds.world_evidence import (
    estimate_evidence,
    evidence_key,
    source_hash,
)
from physic_core.batch.workers import started_processes
from physic_core.errors import PhysicError

if TYPE_CHECKING:
    from physic_bench.worlds.ablation import TableRow
    from physic_bench.worlds.evaluation import Evaluator
    from physic_core.body.model import BodyModel
    from physic_core.configuration.model import Config
    from physic_core.configuration.resolve import ResolvedPipeline
    from physic_core.engine.state import Estimates

Record = dict[str, Any]

_EVALUATION_CODE = (
    "physic_bench",
    "physic_core/body",
    "physic_core/engine",
    "physic_core/geometry",
    "physic_core/metrics",
    "physic_core/pipeline/optimise.py",
    "physic_core/pipeline/reconstruction.py",
    "physic_testing",
)
"""Source files on which a row's numbers depend, besides the evidence."""


@dataclass(frozen=True)
class BenchmarkJob:
    """Configuration of the estimators and the table rows that are computed for each world.

    Attributes:
        config: configuration of the backends with their noise, and of the engine settings that
            estimation uses.
        rows: rows of the table.
        folder: cache folder of evidence and rows; None disables the cache.
    """

    config: Config
    rows: tuple[TableRow, ...]
    folder: Path | None


def run_cases(worlds: Sequence[str], work: BenchmarkJob, jobs: int = 1) -> Iterator[Record]:
    """Run the benchmark on several worlds; yield the records in order of completion.

    Args:
        worlds: names of the worlds.
        work: configuration and table rows.
        jobs: number of processes; 1 uses this process.

    Raises:
        PhysicError: the configuration is invalid, or a process was killed. Errors of a single world
            are in its record.
    """
    if jobs == 1:
        yield from (run_world(world, work) for world in worlds)
        return
    others = set(active_children())
    pool = ProcessPoolExecutor(
        jobs, mp_context=get_context("spawn"), initializer=_ignore_interrupts
    )
    try:
        with started_processes():
            futures = [pool.submit(run_world, world, work) for world in worlds]
        for future in as_completed(futures):
            yield future.result()
    except BrokenProcessPool as error:
        raise PhysicError(
            "a process of the benchmark was ended from outside, as happens where memory runs out; "
            "what is done is kept: go on with fewer --jobs"
        ) from error
    except BaseException:
        # Nobody waits for the worlds that are under way: what they finished of their rows is kept.
        for child in set(active_children()) - others:
            child.terminate()
        raise
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _ignore_interrupts() -> None:
    """Ignore SIGINT in a child process, because the parent handles Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_world(name: str, work: BenchmarkJob) -> Record:
    """Run estimators and engine on one world and return its record.

    Returns:
        "name", "people" (truth), "false_alarms", "error" of the estimators, and "rows" by
        key: each with "people" and "scene" of :class:`physic_bench.worlds.evaluation.Evaluator`,
        "seconds", "warnings" and "error".
    """
    from physic_core.adapters.devices import limited_threads

    with limited_threads(work.config.run.threads):
        return _record(name, work)


def _record(world: str, work: BenchmarkJob) -> Record:
    """Load the record of a world from the cache, or compute it."""
    plan, model, skin = _pipeline_and_body(work.config.model_dump_json())

    def file(name: str) -> Path | None:
        code = source_hash(*_EVALUATION_CODE)
        return (
            None
            if work.folder is None
            else work.folder / evidence_key(world, plan) / f"{name}-{code}.json"
        )

    @cache
    def looked() -> tuple[Evaluator, Estimates | None, str]:
        from physic_bench.worlds.evaluation import Evaluator
        from physic_testing.worlds import load_world

        truth = load_world(world)
        try:
            evidence = estimate_evidence(truth, plan, model, work.folder)
        except Exception as error:  # of any backend: it is a failure of this world, and is counted
            return Evaluator(truth, truth.masks[:0], skin), None, f"{type(error).__name__}: {error}"
        return Evaluator(truth, evidence.people.masks, skin), evidence, ""

    def about() -> Record:
        evaluator, _, trouble = looked()
        alarms = len(evaluator.matching.false_alarms)
        people = evaluator.truth_records()
        return {
            "name": world,
            "people": people,
            "false_alarms": alarms,
            "error": trouble,
        }

    def scored(row: TableRow) -> Record:
        evaluator, evidence, trouble = looked()
        if evidence is None:
            return _failed(evaluator, trouble) | {"error": ""}
        return _run_row(row, evidence, evaluator, model)

    def in_order(found: Record) -> bool:
        return not found["error"] and not looked()[2]

    found: Record = kept(file("about"), about, in_order)
    return {
        **found,
        "rows": {
            row.key: kept(file(row.digest), partial(scored, row), in_order) for row in work.rows
        },
    }


def _failed(evaluator: Evaluator, error: str) -> Record:
    """Return the record of a row that gave nothing."""
    people = evaluator.missed_records(error)
    return {"people": people, "scene": {}, "seconds": None, "warnings": [], "error": error}


def _run_row(row: TableRow, evidence: Estimates, evaluator: Evaluator, model: BodyModel) -> Record:
    """Run the engine with the settings of one row and evaluate the result."""
    from physic_bench.worlds.evaluation import engine_estimate, initial_estimate
    from physic_core.pipeline.optimise import run_engine
    from physic_core.pipeline.stage_runner import StageRunner

    stages = StageRunner("cpu", 4)
    start = time.perf_counter()
    try:
        if row.settings is None:
            estimate = initial_estimate(evidence, model, 0.5)
            seconds = None
        else:
            estimate = engine_estimate(run_engine(evidence, row.settings, model, stages))
            seconds = time.perf_counter() - start
        people = evaluator.person_records(estimate)
        scene = evaluator.scene_record(estimate)
    except Exception as error:  # one row that fails in one world is counted, and ends nothing
        return _failed(evaluator, f"{type(error).__name__}: {error}") | {
            "warnings": stages.warnings
        }
    return {
        "people": people,
        "scene": scene,
        "seconds": seconds,
        "warnings": stages.warnings,
        "error": "",
    }


@cache
def _pipeline_and_body(config: str) -> tuple[ResolvedPipeline, BodyModel, Any]:
    """Return the resolved backends, the body model and its surface graph of a config, given as
    JSON.
    """
    from physic_bench.worlds.evaluation import Evaluator
    from physic_core.body import load_body
    from physic_core.configuration.model import Config
    from physic_core.configuration.resolve import resolve

    plan = resolve(Config.model_validate_json(config))
    model = load_body(plan.body_model)
    return plan, model, Evaluator.body_graph(model)
