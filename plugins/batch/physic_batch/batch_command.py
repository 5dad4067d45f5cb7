"""The command ``physic batch``: reconstruct many photos in several processes, with a journal, a
table and a page.
"""

from __future__ import annotations

import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from physic_core.cli.arguments import AnyPath, Device, Number, WholeNumber, configuration_options
from physic_core.cli.output import echo
from physic_core.errors import InputError, OutputError

if TYPE_CHECKING:
    from physic_batch.photo_processor import BatchJob
    from physic_batch.photos import PhotoItem, Shard
    from physic_batch.run import BatchPlan, Executor

_SAVE = (
    "Files per photo, as in physic run; none: only a row of the tables. [default: pictures of up "
    "to 100 photos with a contact sheet, else numbers]"
)
_FEW = 100
"""So many photos have pictures by default."""

_SHOWN = 20
"""Photos that will fail, of which a dry run says why."""

_ROWS = 20
"""New rows after which the tables are written while a batch runs."""

_PAUSES = 20
"""Shortest time between two writings of the tables, as a multiple of the time that the first of
them took.
"""

_LEVELS = ("pictures", "numbers", "people", "none")


@click.command()
@click.argument("photos", nargs=-1)
@click.option("-o", "--out", type=AnyPath(), required=True, help="Folder for all results.")
@click.option(
    "--workers",
    type=WholeNumber(1, 1024),
    help="Worker processes. [default: by cores and memory]",
)
@click.option("--save", type=click.Choice(_LEVELS), help=_SAVE)
@click.option("--no-thumbnails", is_flag=True, help="Write no thumbnails and no contact sheet.")
@click.option(
    "--timeout",
    type=Number(0, 10_000_000),
    default=600,
    show_default=True,
    help="Limit of a photo, CPU seconds, and seconds without work; 0: none.",
)
@click.option(
    "--retry", type=click.Choice(("failed",)), help="Also retry photos that failed before."
)
@click.option("--limit", metavar="N", type=WholeNumber(1), help="Process at most N photos now.")
@click.option(
    "--dry-run", is_flag=True, help="Print the photos to process, one per line, and write nothing."
)
@click.option("--shard", metavar="I/N", help="Process only the I-th of N parts, such as 3/16.")
@click.option(
    "--tables", is_flag=True, help="Only write tables and contact sheet of the rows of all shards."
)
@click.option("--cache", is_flag=True, help="Cache backend outputs; off by default in batches.")
@click.option(
    "--executor",
    metavar="NAME",
    default="local",
    show_default=True,
    help="local, or one from a plugin, such as ray.",
)
@click.option(
    "--address", metavar="ADDRESS", help="Address of a running cluster. [default: started here]"
)
@click.option(
    "--executor-set", metavar="KEY=VALUE", multiple=True, help="Executor setting; may be repeated."
)
@configuration_options
@click.option("--device", type=Device(), metavar="NAME", help="cpu, cuda or cuda:N.")
def batch(
    photos: tuple[str, ...],
    out: Path,
    limit: int | None,
    dry_run: bool,
    shard: str | None,
    tables: bool,
    **options: Any,
) -> None:
    """Reconstruct PHOTOS: files, folders, or a CSV table.

    Run the same command again to resume. A photo that fails becomes a row of the journal with the
    reason.
    """
    from physic_batch.contact_sheet import check_contact_sheet
    from physic_batch.journal import check_tables, journal_name
    from physic_batch.photos import Shard, list_photos
    from physic_batch.run import plan_batch, run_batch

    if tables == bool(photos):
        raise click.UsageError("--tables takes no photos" if tables else "name photos, or --tables")
    with_sheet = not options["no_thumbnails"]
    check_tables(out)
    if with_sheet:
        check_contact_sheet(out)
    if tables:
        _write_and_print_tables(out, with_sheet=with_sheet)
        return
    part = None if shard is None else Shard.parse(shard)
    run = _executor(out, part, options)
    listed = list_photos(photos)
    items = [item for item in listed.photos if part is None or item.id in part]
    default = "pictures" if with_sheet and len(listed.photos) <= _FEW else "numbers"
    job = _job(out, {**options, "save": options["save"] or default}, create_folder=not dry_run)
    plan = plan_batch(
        items,
        job,
        retry_failed=options["retry"] is not None,
        shard=part,
        least_save=options["save"] or "numbers",
    )
    todo = plan.todo[:limit]
    if listed.left_out:
        echo(f"left out: {listed.left_out_in_words()}", err=True)
    echo(_describe_plan(plan, len(items), limit), err=True)
    if dry_run:
        _print_forecast(todo, job)
        return
    folder = Path(job.out)
    write = None if part else partial(_write_tables, folder, with_sheet=with_sheet)
    progress = _Progress(len(todo), write)

    def finish(start: str) -> None:
        echo(f"{start}{_summary(progress.counts + Counter({'': plan.done, **plan.failed}))}")
        if part is None:
            _write_and_print_tables(folder, with_sheet=with_sheet)
        else:
            echo(f"tables of all shards, when they are done: physic batch --tables -o {folder}")

    journal = folder / journal_name(part)
    with _finishing(finish, progress), _stopped_by_signals():
        run_batch(todo, job, run, journal, progress.add)


def _write_tables(folder: Path, *, with_sheet: bool) -> list[Path]:
    from physic_batch.contact_sheet import write_contact_sheet
    from physic_batch.journal import JournalIndex, journal_files, write_tables

    journals = journal_files(folder)
    if not journals:
        raise InputError(f"no journal in {folder}: name the output folder of a batch")
    index = JournalIndex(journals)
    tables = write_tables(folder, index)
    return tables + ([write_contact_sheet(folder, index=index)] if with_sheet else [])


def _write_and_print_tables(folder: Path, *, with_sheet: bool) -> None:
    echo("\n".join(f"wrote {path}" for path in _write_tables(folder, with_sheet=with_sheet)))


def _print_forecast(todo: Sequence[PhotoItem], job: BatchJob) -> None:
    """Print the photos, and to stderr those that will fail as far as that is known."""
    from physic_batch.foreseen_failure import expected_failure

    failing = 0
    for item in todo:
        echo(item.path)
        if reason := expected_failure(item, job.config):
            failing += 1
            if failing <= _SHOWN:
                echo(f"will fail: {item.path}: {reason}", err=True)
    if failing:
        echo(f"{failing:,} of {len(todo):,} photos will fail", err=True)


def _job(out: Path, options: Mapping[str, Any], *, create_folder: bool) -> BatchJob:
    """Check everything that concerns all photos, and return the job; no network is loaded.

    Args:
        out: output folder.
        options: of the command: what to save, and those of the configuration.
        create_folder: whether to create the folder.
    """
    from physic_batch.photo_processor import prepare_job
    from physic_core.configuration.model import load_config

    device = options["device"]
    config = load_config(
        options["file"],
        preset=options["preset"],
        overrides=options["overrides"],
        flags={"--device": {"run": {"device": device}}} if device else {},
    )
    return prepare_job(
        config,
        out,
        options["save"],
        with_thumbnails=not options["no_thumbnails"],
        with_cache=options["cache"],
        create_folder=create_folder,
    )


def _executor(out: Path, part: Shard | None, options: Mapping[str, Any]) -> Executor:
    """Return the executor named by the options, without starting it; its workers write logs into
    the output folder.

    Raises:
        ConfigError: the executor does not have one of the options.
    """
    from physic_batch.run import ExecutorSettings, open_executor
    from physic_core.files import path_to_write

    name = "logs" if part is None else f"logs/{part.number}-of-{part.count}"
    logs = path_to_write(out.absolute(), name)
    executor_options = {}
    for text in options["executor_set"]:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise click.UsageError(f"--executor-set must be KEY=VALUE (got '{text}')")
        executor_options[key.strip()] = value.strip()
    settings = ExecutorSettings(
        options["workers"], options["timeout"] or None, logs, options["address"], executor_options
    )
    return open_executor(options["executor"], settings)


def _describe_plan(plan: BatchPlan, photos: int, limit: int | None) -> str:
    failed = sum(plan.failed.values())
    reasons = ", ".join(f"{number:,} {reason}" for reason, number in plan.reasons.items())
    parts = [f"{photos:,} photos: {plan.done:,} done before"]
    if failed:
        parts.append(f"{failed:,} failed before (--retry failed retries them)")
    parts.append(f"{len(plan.todo):,} to do{f': {reasons}' if reasons else ''}")
    if plan.replaced:
        parts.append(
            f"{plan.replaced:,} of these have a result, which is replaced: name another folder "
            "with -o to keep it"
        )
    if plan.damaged_lines:
        parts.append(f"{plan.damaged_lines:,} damaged lines of the journal are skipped")
    if limit is not None and limit < len(plan.todo):
        parts.append(f"{limit:,} of them now (--limit)")
    return "; ".join(parts)


@contextmanager
def _finishing(finish: Callable[[str], None], progress: _Progress) -> Iterator[None]:
    """Call ``finish`` at the end with what its line begins with."""
    try:
        yield
    except BaseException as error:  # a batch that is stopped has the tables of its rows, too
        if progress.done:
            with suppress(OutputError):
                finish(f"stopped after {progress.done:,} of {progress.total:,} photos: ")
        if isinstance(error, KeyboardInterrupt):
            raise KeyboardInterrupt(f"the rows of {progress.done:,} photos are kept") from error
        raise
    finish("")


class _Progress:
    """Prints a line to stderr for each row, with rate, time left and failures, and has the tables
    written in between.

    Args:
        total: number of photos.
        write: writes the tables; None to write none in between.

    Attributes:
        total: number of photos.
        done: number of rows so far.
        counts: the same by the class of the error, "" of those that are done.
    """

    def __init__(self, total: int, write: Callable[[], Any] | None) -> None:
        self.done = 0
        self.counts = Counter[str]()
        self.total = total
        self._write = write
        self._start = self._next_write = time.monotonic()
        self._unwritten = 0

    def add(self, row: Mapping[str, Any]) -> None:
        """Take a row that was appended to the journal."""
        self.done += 1
        self.counts[row["error"] if row["state"] == "failed" else ""] += 1
        seconds = time.monotonic() - self._start
        message = str(row["message"]).replace(row["path"], Path(row["path"]).name)
        reason = f": {row['error']}: {message}" if row["error"] else ""
        failed = self.done - self.counts[""]
        failures = f", {failed} failed" if failed else ""
        left = _duration((self.total - self.done) * seconds / self.done)
        rate = f"{60 * self.done / seconds:.1f} photos/min, {left} left{failures}"
        echo(f"[{self.done}/{self.total}] {row['state']} {row['path']}{reason} ({rate})", err=True)
        self._unwritten += 1
        if (
            self._write is not None
            and self._unwritten >= _ROWS
            and time.monotonic() >= self._next_write
        ):
            start = time.monotonic()
            # such as of a table that is open elsewhere; the end of the batch reports it
            with suppress(OutputError):
                self._write()
            self._unwritten = 0
            self._next_write = time.monotonic() + _PAUSES * (time.monotonic() - start)


@contextmanager
def _stopped_by_signals() -> Iterator[None]:
    """Inside the block, SIGTERM and SIGHUP do what Ctrl-C does, unless the process ignores them."""
    before = {}
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is signal.SIG_DFL:
                before[number] = signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    if seconds < 7200:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


def _summary(counts: Counter[str]) -> str:
    """Return how many photos are done and failed, by the class of their error ("" if done)."""
    done = counts.pop("", 0)
    reasons = ", ".join(f"{number} {name}" for name, number in counts.most_common())
    again = "; --retry failed retries these" if counts.keys() & {"Timeout", "WorkerDied"} else ""
    return f"{done:,} done, {counts.total():,} failed{f' ({reasons})' if reasons else ''}{again}"
