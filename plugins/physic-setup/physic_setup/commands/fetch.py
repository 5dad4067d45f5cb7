"""The command ``physic weights fetch``: download the weights of installed plugins."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from physic_core.cli.exit_codes import INTERRUPTED, WEIGHTS
from physic_core.cli.output import echo
from physic_core.errors import PhysicError

if TYPE_CHECKING:
    from physic_core.weights.library import ListedWeights
    from physic_setup.fetch import Progress


@click.command()
@click.argument("names", nargs=-1, required=True, metavar="NAME...")
@click.option(
    "--accept-licence",
    "--accept-license",
    "accept",
    is_flag=True,
    help="Accept a licence that restricts use or requires an account.",
)
@click.option(
    "--to",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="FOLDER",
    help="Download to this folder, to copy it to a machine without network. Set PHYSIC_WEIGHTS to it there.",
)
@click.pass_context
def fetch(ctx: click.Context, names: tuple[str, ...], accept: bool, to: Path | None) -> None:
    """Download the missing files of the weight sets NAME..., and verify their size and SHA-256.

    The next call goes on with the files that are missing. Exits with code 4 if one still is.
    """
    from physic_core.discovery.plugins import discover
    from physic_core.weights.library import read_library
    from physic_setup.fetch import fetch as fetch_set

    library = read_library(discover().manifests)
    chosen = [library.get(name) for name in dict.fromkeys(names)]
    failed = False
    for one in chosen:
        name = one.weights.name
        try:
            with _progress(name) as progress:
                fetched = fetch_set(one.weights, accept=accept, to=to, progress=progress)
        except PhysicError as error:
            failed = True
            echo(f"{name}: {error}", err=True)
        except KeyboardInterrupt:
            echo(f"{name}: interrupted; complete files are kept", err=True)
            ctx.exit(INTERRUPTED)
        else:
            where = to / name if to is not None else _location(one)
            echo(f"{name}: {', '.join(fetched)} downloaded to {where}" if fetched else f"{name}: already in {where}")
    ctx.exit(WEIGHTS if failed else 0)


def _location(one: ListedWeights) -> str:
    """Return the folder or the file paths of a weight set, as text."""
    from physic_core.weights.find import locate_files

    here = locate_files(one.weights)
    if len(here.files) == 1 or here.folder is None:
        return ", ".join(map(str, here.files.values()))
    return str(here.folder)


@contextmanager
def _progress(name: str) -> Iterator[Progress]:
    """Yield a progress callback: a bar for each file on a terminal, otherwise one line for each file; on stderr."""
    from physic_core.weights.find import format_size

    if not sys.stderr.isatty():
        started: set[str] = set()

        def print_line(file: str, done: int, total: int | None) -> None:
            if file not in started:
                started.add(file)
                echo(f"{name}: {file} ({format_size(total) or '-'})", err=True)

        yield print_line
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn, TransferSpeedColumn

    parts = (
        TextColumn("{task.description}"),
        BarColumn(),
        DownloadColumn(),
        TransferSpeedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*parts, console=Console(stderr=True)) as bars:
        tasks: dict[str, Any] = {}

        def show_bar(file: str, done: int, total: int | None) -> None:
            if file not in tasks:
                tasks[file] = bars.add_task(f"{name}: {file}", total=total, completed=done)
            bars.update(tasks[file], completed=done, total=total)

        yield show_bar
