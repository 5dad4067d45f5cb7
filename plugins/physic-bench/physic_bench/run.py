"""Evaluate methods on a data set: check the frames of reference, score every frame, collect the records."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from physic_bench.evaluation import Evaluation, Method
from physic_bench.frame_of_results import check_frame
from physic_bench.score_journal import SCORES, append_scores, known_scores, rules_digest, score_digest
from physic_bench.scoring import score_frame
from physic_bench.validation import checked_truth
from physic_bench.wording import counted
from physic_core.errors import InputError, PhysicError

if TYPE_CHECKING:
    from pathlib import Path

    from physic_bench.carry import Carrier
    from physic_bench.contract import Frame, Truth
    from physic_bench.datasets.base import DataSet, FrameSet
    from physic_bench.frame_of_results import FrameCheck

    Record = dict[str, Any]

CHECKED_FRAMES = 10
"""Frames, spread over the data set, that decide in which frame of reference results are."""

IN_PROCESS = 24
"""Up to so many frames are scored without starting processes."""


@dataclass(frozen=True)
class MethodScores:
    """The records of a method on a frame.

    Attributes:
        method: name.
        digest: of everything that they depend on.
        records: one per annotated person; None if the journal has them.
    """

    method: str
    digest: str
    records: tuple[Record, ...] | None


@dataclass(frozen=True)
class FrameScores:
    """The scores of a frame.

    Attributes:
        frame: its id.
        methods: scores of each method.
        left_out: why the frame has none; "" if it has.
    """

    frame: str
    methods: tuple[MethodScores, ...] = ()
    left_out: str = ""


@dataclass(frozen=True, eq=False)
class FrameScorer:
    """Scores all methods on one frame; a worker process holds one.

    Attributes:
        methods: in order.
        carrier: of contact between body meshes.
        known: digests of the records that exist.
    """

    methods: tuple[Method, ...]
    carrier: Carrier
    known: frozenset[str] = frozenset()

    def __call__(self, frame: Frame) -> FrameScores:
        """Return the scores of a frame; damaged files become reasons."""
        try:
            truth = checked_truth(frame)
        except PhysicError as error:
            return FrameScores(frame.id, left_out=str(error))
        return FrameScores(frame.id, tuple(self._scores(frame, truth, method) for method in self.methods))

    def _scores(self, frame: Frame, truth: Truth, method: Method) -> MethodScores:
        prediction, reason = None, method.failures.get(frame.id, "no result")
        try:
            prediction = method.result(frame)
        except PhysicError as error:
            reason = str(error)
        reason = "" if prediction else reason
        digest = score_digest(rules_digest(self.carrier), frame, truth, prediction, method.name, reason)
        if digest in self.known:
            return MethodScores(method.name, digest, None)
        own = score_frame(frame, truth, prediction, method.name, self.carrier, reason)
        if frame.group and prediction is not None:
            own = [record | _world_hips(record, frame) for record in own]
        return MethodScores(method.name, digest, tuple(own))


def require_any_truth(frames: Sequence[Frame], root: Path) -> None:
    """Read truths until one can be used.

    Raises:
        InputError: no frame has one. The message has the first reason.
    """
    reason = ""
    for frame in frames:
        try:
            checked_truth(frame)
            return
        except PhysicError as error:
            reason = reason or str(error)
    raise InputError(f"no frame of {root} can be evaluated: {reason}")


def evaluate_methods(
    data_set: DataSet,
    found: FrameSet,
    methods: Sequence[Method],
    carrier: Carrier,
    root: Path,
    workers: int,
    report: Callable[[str], None] = lambda text: None,
    out: Path | None = None,
) -> Evaluation:
    """Score methods on the frames of a data set.

    Args:
        data_set: of the frames.
        found: its frames.
        methods: at least one.
        carrier: of contact between body meshes.
        root: of the data set.
        workers: processes.
        report: called with one line at a time.
        out: folder whose journal has the scores of earlier calls, and gets new ones; None is without.

    Raises:
        OutputError: another evaluation is writing this folder.
        InputError: a method has no result of any frame, its results fit in no frame of reference, or no frame has a
            truth that can be read.
    """
    for method in methods:
        _require_results(found.frames, method)
    if data_set.needs_results(found):
        results = {frame.id: methods[0].result_or_none(frame) for frame in found.frames}
        found = data_set.complete(found, results, methods[0].name, root)
    require_any_truth(found.frames, root)
    checks = {method.name: _check(found.frames, method) for method in methods}
    for name, check in checks.items():
        report(f"{name}: {check.sentence()}")
    methods = [replace(method, frame=checks[method.name].frame) for method in methods]
    records, left_out = _all_scores(found, methods, carrier, workers, out, report)
    ordered = [record for frame in found.frames for record in records.get(frame.id, ())]
    kept = tuple(frame for frame in found.frames if frame.id not in left_out)
    return Evaluation(tuple(methods), kept, checks, tuple(_with_spread(ordered)), found.notes, left_out)


def _all_scores(
    found: FrameSet,
    methods: Sequence[Method],
    carrier: Carrier,
    workers: int,
    out: Path | None,
    report: Callable[[str], None],
) -> tuple[dict[str, list[Record]], dict[str, str]]:
    """Return frame id -> records, and frame id -> why it is skipped; the journal gets new scores."""
    from physic_core.batch.journal import Journal
    from physic_core.files.atomic import check_writable

    known = {} if out is None else known_scores(out)
    scorer = FrameScorer(tuple(methods), carrier, frozenset(known))
    records: dict[str, list[Record]] = {}
    left_out, old = dict(found.left_out), 0
    with nullcontext() if out is None else Journal(check_writable(out / SCORES) / "journal.jsonl") as journal:
        for scores in _scored(found.frames, scorer, workers):
            if scores.left_out:
                left_out[scores.frame] = scores.left_out
            for score in scores.methods:
                if score.records is None:
                    old += 1
                elif journal is not None:
                    append_scores(journal, scores.frame, score.method, score.digest, score.records)
                own = known[score.digest] if score.records is None else score.records
                records.setdefault(scores.frame, []).extend(own)
    if old:
        report(f"{old} of {counted(len(methods) * len(found.frames), 'score')} unchanged, from {SCORES}/journal.jsonl")
    return records, left_out


def _scored(frames: Sequence[Frame], scorer: FrameScorer, workers: int) -> Iterable[FrameScores]:
    if workers < 2 or len(frames) <= IN_PROCESS:
        yield from map(scorer, frames)
        return
    from physic_core.batch.workers import WorkerSettings, run_in_workers

    for outcome in run_in_workers(list(frames), partial(_same, scorer), WorkerSettings(workers)):
        if outcome.failure:
            yield FrameScores(outcome.task.id, left_out=f"{outcome.failure}: {outcome.message}")
        else:
            yield outcome.value


def _same(scorer: FrameScorer) -> FrameScorer:
    return scorer


def _require_results(frames: Sequence[Frame], method: Method) -> None:
    """Refuse a folder without a result of any frame.

    Raises:
        InputError: with the files that the reader expects, or why the first result cannot be read.
    """
    reason = ""
    for frame in frames:
        try:
            if method.result(frame) is not None:
                return
        except PhysicError as error:
            reason = reason or str(error)
    reason = reason or next((method.failures[frame.id] for frame in frames if frame.id in method.failures), "")
    folder = method.reader.folder
    if reason:
        raise InputError(f"no result of {method.name} in {folder} can be used; the first: {reason}")
    raise InputError(
        f"{folder} has no result of {method.name} for any of {counted(len(frames), 'frame')}, such as {frames[0].id}. "
        f"The reader '{method.reader.name}' expects {method.reader.layout}"
    )


def _check(frames: Sequence[Frame], method: Method) -> FrameCheck:
    samples = []
    for frame in _spread_out(frames):
        try:
            prediction = method.result(frame)
            if prediction is not None:
                samples.append((frame, checked_truth(frame), prediction))
        except PhysicError:
            continue  # scoring reports it
        if len(samples) == CHECKED_FRAMES:
            break
    return check_frame(samples, method.name)


def _spread_out(frames: Sequence[Frame]) -> list[Frame]:
    """Return all frames, the first of them spread over all."""
    step = max(len(frames) // CHECKED_FRAMES, 1)
    return [frame for start in range(step) for frame in frames[start::step]]


def _world_hips(record: Record, frame: Frame) -> Record:
    """Return the predicted middle of the hips in the world as an entry of a record."""
    hips = record.pop("hips_m", None)
    if hips is None:
        return {}
    import numpy as np

    return {"hips_world_m": frame.camera.in_world(np.asarray(hips)).tolist()}


def _with_spread(records: Sequence[Record]) -> list[Record]:
    """Add to one record of each person of a moment how far apart the views put their hips."""
    import numpy as np

    places: dict[tuple[str, str, str], list[Record]] = {}
    for record in records:
        record.pop("hips_m", None)
        if "hips_world_m" in record:
            places.setdefault((record["method"], record["group"], record["person"]), []).append(record)
    for own in places.values():
        if len(own) > 1:
            points = np.array([record["hips_world_m"] for record in own])
            own[0]["spread_mm"] = 1000 * math.sqrt(float(np.square(points - points.mean(0)).sum(-1).mean()))
    return list(records)
