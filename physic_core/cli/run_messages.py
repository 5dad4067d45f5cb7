"""Progress of ``physic run``, and log messages of plugins."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from physic_core.cli.output import echo


@contextmanager
def collect_plugin_messages() -> Iterator[list[tuple[str, str]]]:
    """Yield a list of the distinct INFO log messages of packages named ``physic_*``.

    Each is a pair: what runs the network, as the attribute ``network_runtime`` of the record says ("CPU, onnxruntime
    1.20"), or "" for a message about something else; and the message.
    """
    messages: list[tuple[str, str]] = []

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            message = (getattr(record, "network_runtime", ""), record.getMessage())
            if record.name.startswith("physic_") and record.levelno == logging.INFO and message not in messages:
                messages.append(message)

    root, listener = logging.getLogger(), Listener(logging.INFO)
    level = root.level
    root.addHandler(listener)
    root.setLevel(min(level, logging.INFO))
    try:
        yield messages
    finally:
        root.removeHandler(listener)
        root.setLevel(level)


def print_messages(messages: Sequence[tuple[str, str]], verbose: bool) -> None:
    """Print one line about the networks to stderr, or with ``verbose`` all messages."""
    runtimes = ", ".join(dict.fromkeys(runtime for runtime, _ in messages if runtime))
    if verbose:
        for _, text in messages:
            echo(text, err=True)
    elif runtimes:
        echo(f"networks: {runtimes}", err=True)


@contextmanager
def show_progress(quiet: bool = False) -> Iterator[Callable[[str, int, int], None]]:
    """Yield a progress callback: a bar on a terminal, otherwise one line for each stage; on stderr."""
    if quiet:
        yield lambda name, done, total: None
        return
    if not sys.stderr.isatty():
        yield lambda name, done, total: echo(f"[{done + 1}/{total}] {name}", err=True)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description:<24}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=None)

        def show(name: str, done: int, total: int) -> None:
            bar.update(task, description=name, completed=done, total=total)

        yield show
