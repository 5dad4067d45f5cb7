"""Output of commands: text with control characters escaped, tables, TOML, messages, progress, and
the result folder.
"""

from __future__ import annotations

import json
import logging
import math
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import click

from physic_core.errors import OutputError
from physic_core.files.text import printable


def echo(text: object, *, nl: bool = True, err: bool = False) -> None:
    """Print a text, with control characters that a terminal would obey escaped.

    Args:
        text: may contain file names, plugin messages, and other untrusted text.
        nl: whether to print a newline after it.
        err: whether to print to stderr. If it cannot be written, the text is lost, and no result.

    Raises:
        OutputError: the standard output cannot be written, such as to a full disk.
        BrokenPipeError: the reader of the standard output is gone.
    """
    try:
        click.echo(printable(str(text)), nl=nl, err=err)
    except BrokenPipeError:
        raise
    except OSError as error:
        if not err:
            raise OutputError(f"cannot print the answer: {error.strerror}") from error


def echo_json(value: object) -> None:
    """Print a value as JSON."""
    # DEL is the one control character that JSON leaves as it is.
    echo(json.dumps(value, indent=2).replace("\x7f", "\\u007f"))


@contextmanager
def printed_logs() -> Iterator[None]:
    """Print Python's warnings, and warnings and errors of loggers, like all other lines, unless
    handlers exist.
    """
    root = logging.getLogger()
    handler = _EchoHandler(logging.WARNING)
    if not root.handlers:  # logging.basicConfig of a library then adds none
        root.addHandler(handler)
        logging.captureWarnings(True)
    try:
        yield
    finally:
        logging.captureWarnings(False)
        root.removeHandler(handler)


class _EchoHandler(logging.Handler):
    """Prints log records to stderr."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        echo(self.format(record).rstrip("\n"), err=True)


def format_table(rows: Sequence[tuple[str, ...]]) -> str:
    """Format rows of text as a table with aligned columns."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]) - 1)]
    return "\n".join(
        "  ".join([*(f"{t:<{w}}" for t, w in zip(row, widths, strict=False)), row[-1]])
        for row in rows
    )


def toml_value(value: Any) -> str:
    """Format a bool, number, text, list or dictionary as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k} = {toml_value(v)}" for k, v in value.items()) + "}"
    text = json.dumps(value, ensure_ascii=False)
    # A path that is not UTF-8 has surrogates, which TOML cannot express and a terminal cannot
    # print.
    return text.encode(errors="backslashreplace").decode()


@contextmanager
def collect_plugin_messages() -> Iterator[list[str]]:
    """Yield a list of the distinct INFO log messages of packages named ``physic_*``."""
    messages: list[str] = []

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            message = record.getMessage()
            if (
                record.name.startswith("physic_")
                and record.levelno == logging.INFO
                and message not in messages
            ):
                messages.append(message)

    root = logging.getLogger()
    listener = Listener(logging.INFO)
    level = root.level
    root.addHandler(listener)
    root.setLevel(min(level, logging.INFO))
    try:
        yield messages
    finally:
        root.removeHandler(listener)
        root.setLevel(level)


@contextmanager
def show_progress(quiet: bool) -> Iterator[Callable[[str, int, int], None] | None]:
    """Yield the callback ``progress`` of a pipeline: on stderr, a bar with the time on a terminal,
    otherwise lines.
    """
    if quiet or not sys.stderr.isatty():
        yield (
            None
            if quiet
            else lambda name, done, total: echo(f"[{done + 1}/{total}] {name}", err=True)
        )
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description:<24}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=None)
        yield lambda name, done, total: bar.update(
            task, description=name, completed=done, total=total
        )


@contextmanager
def reserve_folder(folder: Path, photo: str, *, overwrite: bool) -> Iterator[None]:
    """Check that a result can be written to a folder; after an error, new folders above it that are
    empty are deleted.

    Args:
        folder: of the result.
        photo: digests of its photo, or of all photos; "" if the photo cannot be read, which the run
            reports.
        overwrite: whether the result of another photo may be replaced.

    Raises:
        OutputError: the folder cannot be written, or has a file of the user.
    """
    from physic_core.io.result_folder import prepare_result_folder

    parents = [*reversed(Path(os.path.realpath(folder)).parents)]
    new = [parent for parent in parents if not os.path.exists(parent)]
    try:
        prepare_result_folder(folder, photo, overwrite=overwrite or not photo)
        yield
    except BaseException:
        for created in reversed(new):
            with suppress(OSError):  # it is not empty
                created.rmdir()
        raise
