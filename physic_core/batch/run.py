"""Run a batch: decide which photos to do, let an executor do them, and write a row of the journal
for each.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from physic_core.batch.journal import THUMBNAIL, Journal, read_journals
from physic_core.batch.photos import PhotoItem, photo_folder
from physic_core.batch.process import BatchJob, PhotoProcessor, failed_row
from physic_core.batch.workers import WorkerSettings, default_workers, run_in_workers
from physic_core.discovery.catalog import EXECUTORS
from physic_core.discovery.plugins import find_item, import_item
from physic_core.errors import ConfigError, PluginError
from physic_core.files.atomic import check_writable
from physic_core.io.result_folder import ARRAYS_FILE, file_digest, run_of_result

Executor = Callable[[Iterable[PhotoItem], BatchJob], Generator[dict[str, Any], None, None]]
"""Reconstructs photos and yields one row for each, in any order; columns are those of the journal.

It raises PhysicError if the backends cannot be loaded, and OutputError if results cannot be
written.
"""

_NEEDED = ("state", "config", "save", "files", "result", "photo", "bytes", "modified")


@dataclass(frozen=True)
class BatchPlan:
    """Photos of a batch that are to be done, and counts of the others.

    Attributes:
        todo: photos without a valid row in the journal.
        done: number of photos that are done.
        failed: number of photos that failed in an earlier run and are not tried again.
        replaced: number of the photos in ``todo`` that are done with other settings, whose results
            are replaced.
        again: number of the other photos in ``todo`` that were tried before, with other content or
            settings, or that were done before, but with files missing, truncated or replaced.
    """

    todo: tuple[PhotoItem, ...]
    done: int
    failed: int
    replaced: int
    again: int


def plan_batch(
    items: Iterable[PhotoItem], job: BatchJob, *, retry_failed: bool = False
) -> BatchPlan:
    """Compare the photos with the journals in the output folder.

    A photo is done anew if its content, the configuration, its settings or what is saved differ
    from its last row, or if its files are missing, truncated or of another run. Content is compared
    by size and modification time first, then by digest.

    Args:
        items: the photos.
        job: of the batch.
        retry_failed: whether photos that failed are done again.
    """
    rows = read_journals(Path(job.out), _NEEDED)
    todo: list[PhotoItem] = []
    count: Counter[str] = Counter()
    for item in items:
        row = rows.get(item.id)
        if row is None:
            todo.append(item)
        elif not _is_current(row, item, job):
            todo.append(item)
            is_result = row["state"] == "done" and not _has_settings(row, item, job)
            count["replaced" if is_result else "again"] += 1
        elif not _has_its_files(row, item, job):
            todo.append(replace(item, replaces=tuple(_sizes(row))))
            count["again"] += 1
        elif row["state"] == "failed" and retry_failed:
            todo.append(item)
        else:
            count[row["state"]] += 1
    return BatchPlan(
        tuple(item.stamped() for item in todo),
        count["done"],
        count["failed"],
        count["replaced"],
        count["again"],
    )


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
        executor: such as ``open_executor("local", settings)`` of :mod:`physic_core.batch.run`.
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


def _has_settings(row: Mapping[str, Any], item: PhotoItem, job: BatchJob) -> bool:
    return bool(row["config"] == job.digest(item) and row.get("save") == job.save)


def _is_current(row: Mapping[str, Any], item: PhotoItem, job: BatchJob) -> bool:
    item = item.stamped()
    if not _has_settings(row, item, job):
        return False
    if item.stamp is None:
        return row.get("bytes") is None
    if item.stamp == (row.get("bytes"), row.get("modified")):
        return True
    return item.stamp[0] == row.get("bytes") and file_digest(item.path) == row.get("photo")


def _has_its_files(row: Mapping[str, Any], item: PhotoItem, job: BatchJob) -> bool:
    """Return whether the folder of a photo holds the result that its row states, with all its
    files.

    Pictures and the document may be edited; the size of the arrays must agree. The thumbnail does
    not count.
    """
    if job.save == "none":
        return True
    folder = Path(job.out, photo_folder(item.id))
    sizes = _sizes(row)
    if row["state"] == "done" and not row.get("result"):
        return False
    # files of a later run that was killed before its row
    if run_of_result(folder) != row.get("result"):
        return False
    try:
        found = {name: (folder / name).lstat().st_size for name in sizes}
    except OSError:
        return False
    return found.get(ARRAYS_FILE) == sizes.get(ARRAYS_FILE)


def _sizes(row: Mapping[str, Any]) -> dict[str, int]:
    """Return name -> bytes of the files in a photo's folder that its row of the journal states."""
    pairs = (text.rpartition("=") for text in str(row.get("files", "")).split())
    return {name: int(size) for name, _, size in pairs if name != THUMBNAIL}


_LOCAL = "local"


@dataclass(frozen=True)
class ExecutorSettings:
    """Settings with which an executor runs the photos of a batch.

    Attributes:
        workers: number of processes or actors; None lets the executor choose.
        timeout: of one photo, as of :class:`physic_core.batch.workers.WorkerSettings`; None for no
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


def open_executor(name: str, settings: ExecutorSettings) -> Executor:
    """Return the executor of a name: "local", or one that a plugin offers.

    Raises:
        ConfigError: the executor does not exist, or does not have one of the settings.
        PluginError: it cannot be imported, or returns no function.
    """
    if name == _LOCAL:
        return _local(settings)
    found = find_item("physic_executors", name, "executor", own=_LOCAL, known=EXECUTORS)
    executor: Executor = import_item(found, "executor")(settings)
    if not callable(executor):
        raise PluginError(
            f"the executor '{name}' should return a function, got {type(executor).__name__}"
        )
    return executor


def _local(settings: ExecutorSettings) -> Executor:
    if settings.address is not None or settings.options:
        option = "--executor-set" if settings.address is None else "--address"
        raise ConfigError(
            f"{option} is for clusters; the executor 'local' uses this machine (see --executor)"
        )

    def run(items: Iterable[PhotoItem], job: BatchJob) -> Generator[dict[str, Any], None, None]:
        count = settings.workers or partial(default_workers, device=job.config.run.device)
        return run_locally(items, job, WorkerSettings(count, settings.timeout, settings.logs))

    return run
