"""The command ``physic batch``: reconstruct many photos in several processes, with a journal, a
table and a page.
"""

from __future__ import annotations

import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from physic_core.cli.arguments import AnyPath, Device, Number, WholeNumber, configuration_options
from physic_core.cli.output import echo
from physic_core.errors import OutputError

if TYPE_CHECKING:
    from physic_core.batch.process import BatchJob
    from physic_core.batch.run import BatchPlan, Executor

_SAVE = "Files per photo, as in physic run; none: only a row of the tables."
_ROWS = 20
"""New rows after which the tables are written while a batch runs."""

_PAUSES = 20
"""Shortest time between two writings of the tables, as a multiple of the time that the first of
them took.
"""

_LEVELS = ("pictures", "numbers", "people", "none")


@click.command()
@click.argument("photos", nargs=-1, required=True)
@click.option("-o", "--out", type=AnyPath(), required=True, help="Folder for all results.")
@click.option(
    "--workers",
    type=WholeNumber(1, 1024),
    help="Worker processes. [default: by cores and memory]",
)
@click.option(
    "--save", type=click.Choice(_LEVELS), default="numbers", show_default=True, help=_SAVE
)
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
    **options: Any,
) -> None:
    """Reconstruct PHOTOS: files, folders, or a CSV table.

    Run the same command again to resume. A photo that fails becomes a row of the journal with the
    reason.
    """
    from physic_core.batch.contact_sheet import check_contact_sheet, write_contact_sheet
    from physic_core.batch.journal import check_tables, write_tables
    from physic_core.batch.photos import Shard, list_photos
    from physic_core.batch.run import plan_batch, run_batch

    check_tables(out)
    if not options["no_thumbnails"]:
        check_contact_sheet(out)
    name = "journal.jsonl"
    logs = out.absolute() / "logs"
    if shard is not None:
        part = Shard.parse(shard)
        words = f"{part.number}-of-{part.count}"
        name = f"journal-{words}.jsonl"
        logs = logs / words
    run = _executor(logs, options)
    listed = list_photos(photos, out)
    items = listed.photos
    if shard is not None:
        items = [item for item in items if item.id in part]
    job = _job(out, options, write=not dry_run)
    plan = plan_batch(items, job, retry_failed=options["retry"] is not None)
    todo = plan.todo[:limit]
    now = f"; {len(todo):,} of them now (--limit)" if len(todo) < len(plan.todo) else ""
    if listed.skipped:
        echo(f"files skipped (not photos, hidden, or of results): {listed.skipped:,}", err=True)
    echo(_describe(plan, len(items)) + now, err=True)
    if dry_run:
        for item in todo:
            echo(item.path)
        return
    folder = Path(job.out)

    def write() -> list[Path]:
        return write_tables(folder) + ([write_contact_sheet(folder)] if job.thumbnails else [])

    def finish(start: str) -> None:
        written = write()
        echo(f"{start}{_summary(folder, items)}")
        echo("\n".join(f"wrote {path}" for path in written))

    progress = _Progress(len(todo), write if shard is None else None)
    try:
        with _stopped_by_signals():
            run_batch(todo, job, run, folder / name, progress.add)
    except BaseException:  # a batch that is stopped has the tables of its rows, too
        if progress.done:
            with suppress(OutputError):
                finish(f"stopped after {progress.done:,} of {len(todo):,} photos: ")
        raise
    finish("")


def _job(out: Path, options: Mapping[str, Any], *, write: bool) -> BatchJob:
    """Check everything that concerns all photos, and return the job; no network is loaded.

    Args:
        out: output folder.
        options: of the command: what to save, and those of the configuration.
        write: whether to create the folder.
    """
    from physic_core.batch.process import prepare_job
    from physic_core.configuration.model import load_config

    file = options["file"]
    preset = options["preset"]
    device = options["device"]
    save = options["save"]
    thumbnails = not options["no_thumbnails"]
    flags = {"--device": {"run": {"device": device}}} if device else {}
    config = load_config(file, preset=preset, overrides=options["overrides"], flags=flags)
    cache = options["cache"]
    return prepare_job(config, out, save, thumbnails=thumbnails, cache=cache, write=write)


def _executor(logs: Path, options: Mapping[str, Any]) -> Executor:
    """Return the executor named by the options, without starting it.

    Raises:
        ConfigError: the executor does not have one of the options.
    """
    from physic_core.batch.run import ExecutorSettings, open_executor

    given = {}
    for text in options["executor_set"]:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise click.UsageError(f"--executor-set must be KEY=VALUE (got '{text}')")
        given[key.strip()] = value.strip()
    settings = ExecutorSettings(
        options["workers"], options["timeout"] or None, logs, options["address"], given
    )
    return open_executor(options["executor"], settings)


def _describe(plan: BatchPlan, photos: int) -> str:
    parts = [f"{photos:,} photos: {len(plan.todo):,} to do, {plan.done:,} done before"]
    if plan.failed:
        parts.append(f"{plan.failed:,} failed before (--retry failed retries them)")
    if plan.replaced:
        parts.append(
            f"{plan.replaced:,} of those to do have a result of other settings, which is replaced: "
            "name another folder with -o to keep it"
        )
    if plan.again:
        parts.append(
            f"{plan.again:,} of those to do were tried before, but photo, settings or files differ"
        )
    return "; ".join(parts)


class _Progress:
    """Prints a line to stderr for each row, with rate, time left and failures, and has the tables
    written in between.

    Args:
        total: number of photos.
        write: writes the tables; None to write none in between.

    Attributes:
        done: number of rows so far.
    """

    def __init__(self, total: int, write: Callable[[], Any] | None) -> None:
        self.done = 0
        self._total = total
        self._write = write
        self._start = self._next_write = time.monotonic()
        self._failed = self._unwritten = 0

    def add(self, row: Mapping[str, Any]) -> None:
        """Take a row that was appended to the journal."""
        self.done += 1
        self._failed += row["state"] == "failed"
        seconds = time.monotonic() - self._start
        message = str(row["message"]).replace(row["path"], Path(row["path"]).name)
        reason = f": {row['error']}: {message}" if row["error"] else ""
        failures = f", {self._failed} failed" if self._failed else ""
        left = _duration((self._total - self.done) * seconds / self.done)
        rate = f"{60 * self.done / seconds:.1f} photos/min, {left} left{failures}"
        echo(f"[{self.done}/{self._total}] {row['state']} {row['path']}{reason} ({rate})", err=True)
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


def _summary(out: Path, items: list[Any]) -> str:
    from physic_core.batch.journal import read_journals

    rows = read_journals(out, ("state", "error"))
    wanted = {item.id for item in items}
    states = Counter(row["state"] for name, row in rows.items() if name in wanted)
    errors = Counter(row["error"] for name, row in rows.items() if name in wanted and row["error"])
    reasons = ", ".join(f"{number} {error}" for error, number in errors.most_common())
    again = (
        "; --retry failed tries these again" if errors.keys() & {"Timeout", "WorkerDied"} else ""
    )
    return (
        f"{states['done']:,} done, {states['failed']:,} "
        f"failed{f' ({reasons})' if reasons else ''}{again}"
    )
