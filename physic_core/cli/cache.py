"""``physic cache``: what is kept of the backends' answers, and how to be rid of it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from physic_core.errors import InputError

if TYPE_CHECKING:
    from physic_core.cache.shelf import Kept

__all__ = ["cache"]


@click.group()
def cache() -> None:
    """Look at the backends' kept answers, or remove them."""


@cache.command()
def info() -> None:
    """Print where answers are kept, how many of which backend, and what they take."""
    from physic_core.cache.shelf import kept

    folder = _folder()
    files = kept(folder)
    click.echo(f"{folder}: {_sum(files)}")
    for line in _by_backend(files):
        click.echo(line)


@cache.command()
def clear() -> None:
    """Remove every kept answer, and print what was removed; results of runs stay."""
    from physic_core.cache.shelf import clear as remove

    folder = _folder()
    files = remove(folder)
    for line in _by_backend(files):
        click.echo(line)
    click.echo(f"removed {_sum(files)} from {folder}")


def _folder() -> Path:
    from physic_core.cache.places import SWITCH, answers_folder

    folder = answers_folder()
    if folder is None:
        raise InputError(f"the cache is switched off by the environment variable {SWITCH}: unset it to see the cache")
    return folder


def _by_backend(files: Iterable[Kept]) -> list[str]:
    """A line for each interface and backend, by name."""
    groups: dict[tuple[str, str], list[Kept]] = {}
    for file in files:
        interface, _, rest = file.path.name.partition("-")
        groups.setdefault((interface, rest.rpartition("-")[0]), []).append(file)
    width = max((len(backend) for _, backend in groups), default=0)
    return [
        f"  {interface:<17}  {backend:<{width}}  {len(group):>6}  {_size(group):>10}"
        for (interface, backend), group in sorted(groups.items())
    ]


def _sum(files: list[Kept]) -> str:
    return f"{len(files)} {'answer' if len(files) == 1 else 'answers'}, {_size(files)}"


def _size(files: Iterable[Kept]) -> str:
    return f"{sum(file.size for file in files) / 1e6:.1f} MB"
