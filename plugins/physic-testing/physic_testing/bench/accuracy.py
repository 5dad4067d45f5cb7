"""Worlds through the estimators once and through the engine once a row; each world's record as it is done.

One process works on one world at a time. What is computed is kept: evidence and rows lie in a folder by what made
them, so that a run that was stopped, or one with a row more, goes on from there.
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

from physic_core.errors import PhysicError
from physic_core.files.strict_json import to_json
from physic_testing.bench.cases import Case, evidence_key, look, source_hash

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.configuration.model import Config
    from physic_core.configuration.resolve import ResolvedPipeline
    from physic_core.pipeline.estimate import Estimates
    from physic_testing.bench.judge import Judge
    from physic_testing.bench.rows import Row

__all__ = ["Work", "run_cases", "run_one"]

Record = dict[str, Any]

_JUDGED_BY = (
    "physic_core/body",
    "physic_core/engine",
    "physic_core/geometry",
    "physic_core/metrics",
    "physic_core/pipeline/optimise.py",
    "physic_testing",
)
"""Code that a row's numbers depend on, beside the evidence."""

_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Work:
    """What is done with every world.

    Attributes:
        config: backends with their noise; its engine settings are those that perception itself needs.
        rows: of the table.
        folder: where evidence and rows are kept between runs; None keeps nothing.
    """

    config: Config
    rows: tuple[Row, ...]
    folder: Path | None


def run_cases(cases: Sequence[Case], work: Work, jobs: int = 1) -> Iterator[Record]:
    """Records of the worlds, in the order in which they are done.

    Args:
        cases: worlds.
        work: what is done with each.
        jobs: processes; 1 works in this one.

    Raises:
        PhysicError: the configuration does not hold, or a process was killed. What fails in a world is in its record.
    """
    if jobs == 1:
        yield from (run_one(case, work) for case in cases)
        return
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))  # the children read it as they import
    try:
        others = set(active_children())
        pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_quiet)
        try:
            for future in as_completed([pool.submit(run_one, case, work) for case in cases]):
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


def _quiet() -> None:
    """Ctrl-C reaches the whole group of processes; the parent alone answers it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_one(case: Case, work: Work) -> Record:
    """The record of one world.

    Returns:
        "name", "seed", "people" (truth), "false_alarms", "error" of perception, and "rows" by their keys: each with
        "people" and "scene" as :class:`physic_testing.bench.judge.Judge` gives them, "seconds", "warnings" and "error".
    """
    from physic_core.adapters.threads import limited_threads

    with limited_threads(work.config.run.threads):
        return _record(case, work)


def _record(case: Case, work: Work) -> Record:
    plan, model, skin = _ready(work.config)
    folder = None if work.folder is None else work.folder / evidence_key(case, plan)
    known = {row.key: _kept(folder, row) for row in work.rows}
    about = _kept_about(folder)
    if about is not None and all(known.values()):
        return {**about, "rows": known}

    from physic_testing.bench.judge import Judge
    from physic_testing.worlds import build_world

    start = time.perf_counter()
    world = build_world(case.name, case.seed, case.size)
    built = time.perf_counter()
    evidence: Estimates | None = None
    trouble = ""
    try:
        evidence = look(case, world, plan, model, work.folder)
    except Exception as error:  # of any backend: it is a failure of this world, and is counted
        trouble = _told(error)
    looked = time.perf_counter()
    judge = Judge(world, world.masks[:0] if evidence is None else evidence.people.masks, skin)
    about = to_json(
        {
            "name": case.name,
            "seed": case.seed,
            "people": judge.truth(),
            "false_alarms": len(judge.matching.false_alarms),
            "error": trouble,
            "world_seconds": built - start,
            "perception_seconds": looked - built,
        },
        digits=7,
    )
    if trouble:
        lost: Record = {"people": judge.missed(trouble), "scene": {}, "seconds": None, "warnings": [], "error": ""}
        return {**about, "rows": {row.key: lost for row in work.rows}}
    assert evidence is not None
    for row in work.rows:
        if known[row.key] is None:
            found = to_json(_run_row(row, evidence, judge, model), digits=7)
            known[row.key] = found
            if not found["error"]:
                _keep(folder, row.digest, found)
    _keep(folder, "about", about)
    return {**about, "rows": known}


def _run_row(row: Row, evidence: Estimates, judge: Judge, model: BodyModel) -> Record:
    from physic_core.pipeline.optimise import run_engine
    from physic_core.pipeline.stage_runner import StageRunner
    from physic_testing.bench.judge import guess_of, start_guess

    stages = StageRunner("cpu", 4)
    start = time.perf_counter()
    try:
        if row.settings is None:
            guess = start_guess(evidence, model, 0.5)
        else:
            guess = guess_of(run_engine(evidence, row.settings, model, stages))
        seconds = time.perf_counter() - start
        return {
            "people": judge.people(guess),
            "scene": judge.scene(guess),
            "seconds": None if row.settings is None else seconds,
            "warnings": stages.warnings,
            "error": "",
        }
    except Exception as error:  # one row that fails in one world is counted, and ends nothing
        told = _told(error)
        return {"people": judge.missed(told), "scene": {}, "seconds": None, "warnings": stages.warnings, "error": told}


def _told(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


def _ready(config: Config) -> tuple[ResolvedPipeline, BodyModel, Any]:
    """Backends, body and the graph of its skin, made once a process."""
    return _made(config.model_dump_json())


@cache
def _made(config: str) -> tuple[ResolvedPipeline, BodyModel, Any]:
    from physic_core.body import load_body
    from physic_core.configuration.model import Config
    from physic_core.configuration.resolve import resolve
    from physic_core.discovery.plugins import discover
    from physic_testing.bench.judge import Judge

    plan = resolve(Config.model_validate_json(config), discover())
    model = load_body(plan.body_model)
    return plan, model, Judge.skin(model)


# ---- what is kept ----------------------------------------------------------------------------------------------------


def _kept(folder: Path | None, row: Row) -> Record | None:
    return None if folder is None else _read(folder / f"{row.digest}-{source_hash(_JUDGED_BY)}.json")


def _kept_about(folder: Path | None) -> Record | None:
    return None if folder is None else _read(folder / f"about-{source_hash(_JUDGED_BY)}.json")


def _keep(folder: Path | None, name: str, record: Record) -> None:
    from physic_core.files.atomic import atomic_write

    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(folder) as temporary:
            temporary(f"{name}-{source_hash(_JUDGED_BY)}.json").write_text(json.dumps(record), encoding="utf-8")


def _read(path: Path) -> Record | None:
    with suppress(OSError, ValueError):
        found = json.loads(path.read_text(encoding="utf-8"))
        return found if isinstance(found, dict) else None
    return None
