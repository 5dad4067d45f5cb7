"""Run a batch: decide which photos to do, let an executor do them, and write a row of the journal
for each.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from physic_batch.journal import THUMBNAIL, Journal, JournalIndex, journal_files
from physic_batch.photo_processor import OTHER_CODE, BatchJob, PhotoProcessor, failed_row
from physic_batch.photos import PhotoItem, Shard, photo_folder
from physic_batch.workers import WorkerSettings, default_workers, run_in_workers
from physic_core.discovery.catalog import EXECUTORS
from physic_core.discovery.plugins import find_item, import_item
from physic_core.errors import ConfigError, PluginError
from physic_core.files import check_writable, paths_inside
from physic_core.io.result_folder import ARRAYS_FILE, file_digest, run_of_result
from physic_core.io.results import SAVE

Executor = Callable[[Iterable[PhotoItem], BatchJob], Generator[dict[str, Any], None, None]]
"""Reconstructs photos and yields one row for each, in any order; columns are those of the journal.

It raises PhysicError if the backends cannot be loaded, and OutputError if results cannot be
written.
"""

_LOST = "files missing or damaged"
_LEVELS = ("none", *reversed(SAVE))
"""What can be saved; each has the files of those before it."""


@dataclass(frozen=True)
class BatchPlan:
    """Photos of a batch that are to be done, and counts of the others.

    Attributes:
        todo: photos without a valid row in the journal.
        reasons: number of photos in ``todo`` by reason, such as "photo changed".
        done: number of photos that are done.
        failed: number of photos that failed in an earlier run and are not tried again, by error.
        replaced: number of the photos in ``todo`` that have a whole result, which is replaced.
        damaged_lines: number of lines of the journals that are no row.
    """

    todo: tuple[PhotoItem, ...]
    reasons: Mapping[str, int]
    done: int
    failed: Mapping[str, int]
    replaced: int
    damaged_lines: int


def plan_batch(
    items: Sequence[PhotoItem],
    job: BatchJob,
    *,
    retry_failed: bool = False,
    shard: Shard | None = None,
    least_save: str | None = None,
) -> BatchPlan:
    """Compare the photos with the journals in the output folder.

    A photo is done anew if its content, the configuration, its settings, or the code and version of
    the core and of a chosen plugin differ from its last row, or if its files are missing, truncated
    or of another run. Content is compared by the stamp of the file first, then by digest.

    Args:
        items: the photos.
        job: of the batch.
        retry_failed: whether photos that failed are done again.
        shard: whose photos these are; journals of its sister shards are not read.
        least_save: what must be saved; the default is what the job saves.
    """
    index = JournalIndex(journal_files(Path(job.out), shard))
    todo: list[PhotoItem] = []
    reasons: Counter[str] = Counter()
    rest: Counter[str] = Counter()
    replaced = 0
    rows = index.rows((item.id for item in items), with_people=False)
    for item, row in zip(items, rows, strict=True):
        item = item.stamped()
        reason = "new" if row is None else _redo_reason(row, item, job, least_save or job.save)
        if row is None or reason == _LOST:
            todo.append(item)
        elif reason or (retry_failed and row["state"] == "failed"):
            todo.append(item)
            replaced += row["state"] == "done" and row.get("save") != "none"
            reason = reason or "failed before"
        else:
            rest["" if row["state"] == "done" else row.get("error", "")] += 1
        if reason:
            reasons[reason] += 1
    return BatchPlan(tuple(todo), reasons, rest.pop("", 0), rest, replaced, index.damaged)


def run_batch(
    items: Iterable[PhotoItem],
    job: BatchJob,
    executor: Executor,
    journal: Path,
    on_row: Callable[[Mapping[str, Any]], None] = lambda row: None,
) -> None:
    """Reconstruct photos and append a row for each to a journal file, when its files are complete.

    Args:
        items: photos to do, such as ``plan_batch(...).todo``.
        job: of the batch.
        executor: such as ``open_executor("local", settings)`` of :mod:`physic_batch.run`.
        journal: file in the output folder, called ``journal*.jsonl``.
        on_row: called after each row.

    Raises:
        OutputError: results or journal cannot be written.
        PhysicError: the backends cannot be loaded.
    """
    check_writable(job.out)
    with Journal(journal) as log, closing(executor(items, job)) as rows:
        for row in rows:
            log.append(row)
            on_row(row)


def run_locally(
    items: Iterable[PhotoItem],
    job: BatchJob,
    settings: WorkerSettings,
    open_worker: Callable[[], Callable[[PhotoItem], dict[str, Any]]] | None = None,
) -> Generator[dict[str, Any], None, None]:
    """Yield a row for each photo from worker processes; see :data:`Executor`.

    ``open_worker`` replaces the pipeline of the job.
    """
    open_worker = open_worker or partial(PhotoProcessor, job)
    with closing(run_in_workers(items, open_worker, settings)) as outcomes:
        for one in outcomes:
            if one.failure:
                yield failed_row(job, one.task, one.failure, one.message, one.seconds, one.attempts)
            else:
                yield {**one.value, "attempts": one.attempts}


def _redo_reason(row: Mapping[str, Any], item: PhotoItem, job: BatchJob, least_save: str) -> str:
    """Return why a photo is done again; "" if its row is that of today's photo, settings, code and
    files.
    """
    version, plugins = row.get("version", ""), row.get("plugins", "").split(", ")
    if row["config"] != job.digest(item):
        return "with other settings"
    if version != job.version:
        return f"made by metricbody {version}"
    if plugins != job.plugins.split(", "):
        other = [one for one in plugins if one not in job.plugins.split(", ")]
        named = [one for one in other if one and not one.startswith(OTHER_CODE)]
        return f"made by {' and '.join(named) or f'other code of metricbody {version} or plugins'}"
    if row.get("save") not in _LEVELS[_LEVELS.index(least_save) :]:
        return f"saved as {row.get('save')}"
    if not _is_same_photo(row, item):
        return "photo changed"
    return "" if _has_its_files(row, item, job) else _LOST


def _is_same_photo(row: Mapping[str, Any], item: PhotoItem) -> bool:
    stamp = row.get("stamp", "")
    if item.stamp == stamp:
        return True
    same_size = item.stamp.partition(" ")[0] == stamp.partition(" ")[0]
    return same_size and file_digest(item.path) == row.get("photo")


def _has_its_files(row: Mapping[str, Any], item: PhotoItem, job: BatchJob) -> bool:
    """Return whether the folder of a photo holds the result that its row states, with all its
    files.

    Pictures and the document may be edited; the size of the arrays must agree. The thumbnail does
    not count.
    """
    if row.get("save") == "none":
        return True
    folders = [*paths_inside(job.out, [photo_folder(item.id)]).values()]
    sizes = _stated_sizes(row)
    if not folders or (row["state"] == "done" and not row.get("result")):
        return False
    # files of a later run that was killed before its row
    if run_of_result(folders[0]) != row.get("result"):
        return False
    try:
        there = paths_inside(folders[0], sizes)
        found = {name: path.lstat().st_size for name, path in there.items()}
    except OSError:
        return False
    return len(found) == len(sizes) and found.get(ARRAYS_FILE) == sizes.get(ARRAYS_FILE)


def _stated_sizes(row: Mapping[str, Any]) -> dict[str, int]:
    """Return name -> bytes of the files in a photo's folder that its row of the journal states."""
    pairs = re.findall(r"(\S+)=([0-9]+)", row.get("files", ""))
    return {name: int(size) for name, size in pairs if name != THUMBNAIL}


@dataclass(frozen=True)
class ExecutorSettings:
    """Settings with which an executor runs the photos of a batch.

    Attributes:
        workers: number of processes or actors; None lets the executor choose.
        timeout: of one photo, as of :class:`physic_batch.workers.WorkerSettings`; None for no
            limit.
        logs: folder for what the workers print; None for none.
        address: of a running cluster; None for none, or for what the executor starts itself.
        options: further settings of the executor, as text.
    """

    workers: int | None = None
    timeout: float | None = None
    logs: Path | None = None
    address: str | None = None
    options: Mapping[str, str] = field(default_factory=dict)


_LOCAL = "local"
_QUEUES = ("slurm", "pbs", "sge", "lsf", "htcondor")


def open_executor(name: str, settings: ExecutorSettings) -> Executor:
    """Return the executor of a name: "local", or one that a plugin offers.

    Raises:
        ConfigError: the executor does not exist, or does not have one of the settings.
        PluginError: it cannot be imported, or returns no function.
    """
    if name == _LOCAL:
        return _local_executor(settings)
    if name.lower() in _QUEUES:
        raise ConfigError(
            f"there is no executor '{name}': give each job of the queue a part, as --shard 3/16, "
            f"and see docs/batch.md"
        )
    item = find_item("physic_executors", name, "executor", own=_LOCAL, known=EXECUTORS)
    executor: Executor = import_item(item, "executor")(settings)
    if not callable(executor):
        raise PluginError(
            f"the executor '{name}' should return a function, got {type(executor).__name__}"
        )
    return executor


def _local_executor(settings: ExecutorSettings) -> Executor:
    if settings.address is not None or settings.options:
        option = "--executor-set" if settings.address is None else "--address"
        raise ConfigError(
            f"{option} is for clusters; the executor 'local' uses this machine (see --executor)"
        )

    def run(items: Iterable[PhotoItem], job: BatchJob) -> Generator[dict[str, Any], None, None]:
        count = settings.workers or partial(default_workers, device=job.config.run.device)
        return run_locally(items, job, WorkerSettings(count, settings.timeout, settings.logs))

    return run
