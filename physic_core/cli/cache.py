"""``physic cache``: what is kept of backends' answers and of maps between bodies, and how to be rid of it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from physic_core.cache.places import maps_folder
from physic_core.errors import InputError

if TYPE_CHECKING:
    from physic_core.cache.shelf import Kept

__all__ = ["cache"]


@click.group()
def cache() -> None:
    """Look at what is kept between runs, or remove it: backends' answers, and maps between bodies."""


@cache.command()
def info() -> None:
    """Print where answers are kept, how many of which backend, and what they take; and the maps, if there are any."""
    from physic_core.cache.shelf import MAP_SUFFIX, kept

    folder = _folder()
    files = kept(folder)
    click.echo(f"{folder}: {_sum(files)}")
    for line in _by_backend(files):
        click.echo(line)
    maps = maps_folder()
    if maps is not None and (files := kept(maps, MAP_SUFFIX)):
        click.echo(f"{maps}: {_sum_of_maps(files)}")


@cache.command()
def clear() -> None:
    """Remove every kept answer and map, and print what was removed; results of runs stay."""
    from physic_core.cache.shelf import MAP_SUFFIX
    from physic_core.cache.shelf import clear as remove

    folder = _folder()
    files = remove(folder)
    for line in _by_backend(files):
        click.echo(line)
    click.echo(f"removed {_sum(files)} from {folder}")
    maps = maps_folder()
    if maps is not None and (files := remove(maps, MAP_SUFFIX)):
        click.echo(f"removed {_sum_of_maps(files)} from {maps}")


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


def _sum_of_maps(files: list[Kept]) -> str:
    return f"{len(files)} {'map' if len(files) == 1 else 'maps'} between bodies, {_size(files)}"


def _size(files: Iterable[Kept]) -> str:
    return f"{sum(file.size for file in files) / 1e6:.1f} MB"
