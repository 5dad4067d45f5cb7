"""Printing for all commands: untrusted text must not control the terminal."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import click

from physic_core.files.quoting import printable


def echo(text: object, *, nl: bool = True, err: bool = False) -> None:
    """Print a text, with control characters that a terminal would obey escaped.

    Args:
        text: may contain file names, plugin messages, and other untrusted text.
        nl: whether to print a newline after it.
        err: whether to print to stderr.
    """
    click.echo(printable(str(text)), nl=nl, err=err)


def echo_json(value: object) -> None:
    """Print a value as JSON."""
    import json

    # DEL is the one control character that JSON leaves as it is.
    echo(json.dumps(value, indent=2).replace("\x7f", "\\u007f"))


@contextmanager
def printed_logs() -> Iterator[None]:
    """Print Python's warnings, and warnings and errors of loggers, like all other lines, unless handlers exist."""
    root, handler = logging.getLogger(), _EchoHandler(logging.WARNING)
    if not root.handlers:  # also of logging.basicConfig, which adds none then
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


def open_missing_streams() -> None:
    """Open the null device for closed standard streams: files opened later would take their descriptors."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            null = os.open(os.devnull, os.O_RDWR)
            os.dup2(null, number)
            if null == number:
                os.set_inheritable(number, True)
            else:
                os.close(null)
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, "w" if number else "r", closefd=False))  # noqa: SIM115 -- until the end


def format_table(rows: Sequence[tuple[str, ...]]) -> str:
    """Format rows of text as a table with aligned columns."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]) - 1)]
    return "\n".join("  ".join([*(f"{t:<{w}}" for t, w in zip(row, widths, strict=False)), row[-1]]) for row in rows)
