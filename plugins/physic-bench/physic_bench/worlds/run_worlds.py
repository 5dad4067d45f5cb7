"""Execution of the accuracy benchmark: estimators once per world, then the engine once per table row.

Each process computes one world at a time. Estimates and rows are cached by a hash of their inputs and source code, so
that an interrupted run, or a run with another row, reuses them.
"""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_bench.worlds.world_evidence import WorldCase, estimate_evidence, evidence_key, source_hash
from physic_core.errors import PhysicError
from physic_core.files.strict_json import to_json

if TYPE_CHECKING:
    from physic_bench.worlds.evaluation import Evaluator
    from physic_bench.worlds.table_rows import TableRow
    from physic_core.body.model import BodyModel
    from physic_core.configuration.model import Config
    from physic_core.configuration.resolve import ResolvedPipeline
    from physic_core.pipeline.estimate import Estimates

Record = dict[str, Any]

_EVALUATION_CODE = (
    "physic_core/body",
    "physic_core/engine",
    "physic_core/geometry",
    "physic_core/metrics",
    "physic_core/pipeline/engine_input.py",
    "physic_core/pipeline/optimise.py",
    "physic_core/pipeline/solution.py",
    "physic_testing",
)
"""Source files on which a row's numbers depend, besides the evidence."""

_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class BenchmarkJob:
    """Configuration of the estimators and the table rows that are computed for each world.

    Attributes:
        config: configuration of the backends with their noise, and of the engine settings that estimation uses.
        rows: rows of the table.
        folder: cache folder of evidence and rows; None disables the cache.
    """

    config: Config
    rows: tuple[TableRow, ...]
    folder: Path | None


def run_cases(cases: Sequence[WorldCase], work: BenchmarkJob, jobs: int = 1) -> Iterator[Record]:
    """Run the benchmark on several worlds; yield the records in order of completion.

    Args:
        cases: worlds.
        work: configuration and table rows.
        jobs: number of processes; 1 uses this process.

    Raises:
        PhysicError: the configuration is invalid, or a process was killed. Errors of a single world are in its record.
    """
    if jobs == 1:
        yield from (run_world(case, work) for case in cases)
        return
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))  # the children read it as they import
    try:
        others = set(active_children())
        pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_ignore_interrupts)
        try:
            for future in as_completed([pool.submit(run_world, case, work) for case in cases]):
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
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _ignore_interrupts() -> None:
    """Ignore SIGINT in a child process, because the parent handles Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_world(case: WorldCase, work: BenchmarkJob) -> Record:
    """Run estimators and engine on one world and return its record.

    Returns:
        "name", "seed", "people" (truth), "false_alarms", "error" of the estimators, and "rows" by key: each with
        "people" and "scene" of :class:`physic_bench.worlds.evaluation.Evaluator`, "seconds", "warnings" and "error".
    """
    from physic_core.adapters.threads import limited_threads

    with limited_threads(work.config.run.threads):
        return _record(case, work)


def _record(case: WorldCase, work: BenchmarkJob) -> Record:
    """Load the record of a world from the cache, or compute it."""
    plan, model, skin = _pipeline_and_body(work.config)
    folder = None if work.folder is None else work.folder / evidence_key(case, plan)
    known = {row.key: _load_row(folder, row) for row in work.rows}
    about = _load_world_record(folder)
    if about is not None and all(known.values()):
        return {**about, "rows": known}

    from physic_bench.worlds.evaluation import Evaluator
    from physic_testing.worlds import build_world

    start = time.perf_counter()
    world = build_world(case.name, case.seed, case.size)
    built = time.perf_counter()
    evidence: Estimates | None = None
    trouble = ""
    try:
        evidence = estimate_evidence(case, world, plan, model, work.folder)
    except Exception as error:  # of any backend: it is a failure of this world, and is counted
        trouble = _error_text(error)
    looked = time.perf_counter()
    evaluator = Evaluator(world, world.masks[:0] if evidence is None else evidence.people.masks, skin)
    about = to_json(
        {
            "name": case.name,
            "seed": case.seed,
            "people": evaluator.truth_records(),
            "false_alarms": len(evaluator.matching.false_alarms),
            "error": trouble,
            "world_seconds": built - start,
            "perception_seconds": looked - built,
        },
        digits=7,
    )
    if trouble:
        lost: Record = {
            "people": evaluator.missed_records(trouble),
            "scene": {},
            "seconds": None,
            "warnings": [],
            "error": "",
        }
        return {**about, "rows": {row.key: lost for row in work.rows}}
    assert evidence is not None
    for row in work.rows:
        if known[row.key] is None:
            found = to_json(_run_row(row, evidence, evaluator, model), digits=7)
            known[row.key] = found
            if not found["error"]:
                _save_record(folder, row.digest, found)
    _save_record(folder, "about", about)
    return {**about, "rows": known}


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
        else:
            estimate = engine_estimate(run_engine(evidence, row.settings, model, stages))
        seconds = time.perf_counter() - start
        return {
            "people": evaluator.person_records(estimate),
            "scene": evaluator.scene_record(estimate),
            "seconds": None if row.settings is None else seconds,
            "warnings": stages.warnings,
            "error": "",
        }
    except Exception as error:  # one row that fails in one world is counted, and ends nothing
        message = _error_text(error)
        return {
            "people": evaluator.missed_records(message),
            "scene": {},
            "seconds": None,
            "warnings": stages.warnings,
            "error": message,
        }


def _error_text(error: Exception) -> str:
    """Format an exception as type and message."""
    return f"{type(error).__name__}: {error}"


def _pipeline_and_body(config: Config) -> tuple[ResolvedPipeline, BodyModel, Any]:
    """Return the resolved backends, the body model and its surface graph, cached per process."""
    return _cached_pipeline_and_body(config.model_dump_json())


@cache
def _cached_pipeline_and_body(config: str) -> tuple[ResolvedPipeline, BodyModel, Any]:
    """Resolve the backends and load the body model of a config, given as JSON."""
    from physic_bench.worlds.evaluation import Evaluator
    from physic_core.body import load_body
    from physic_core.configuration.model import Config
    from physic_core.configuration.resolve import resolve
    from physic_core.discovery.plugins import discover

    plan = resolve(Config.model_validate_json(config), discover())
    model = load_body(plan.body_model)
    return plan, model, Evaluator.body_graph(model)


# ---- what is kept ----------------------------------------------------------------------------------------------------


def _load_row(folder: Path | None, row: TableRow) -> Record | None:
    """Load a cached row; None if there is none."""
    return None if folder is None else _read(folder / f"{row.digest}-{source_hash(_EVALUATION_CODE)}.json")


def _load_world_record(folder: Path | None) -> Record | None:
    """Load the cached record of a world without its rows; None if there is none."""
    return None if folder is None else _read(folder / f"about-{source_hash(_EVALUATION_CODE)}.json")


def _save_record(folder: Path | None, name: str, record: Record) -> None:
    """Write a record to the cache."""
    from physic_core.files.atomic import atomic_write

    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(folder) as temporary:
            temporary(f"{name}-{source_hash(_EVALUATION_CODE)}.json").write_text(json.dumps(record), encoding="utf-8")


def _read(path: Path) -> Record | None:
    """Read a JSON object; None if the file is missing or damaged."""
    with suppress(OSError, ValueError):
        found = json.loads(path.read_text(encoding="utf-8"))
        return found if isinstance(found, dict) else None
    return None
