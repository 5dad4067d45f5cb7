"""``physic cache``: show and clear the cache."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from physic_core.cache.folders import correspondences_folder, graphs_folder, hashes_folder
from physic_core.cli.output import echo
from physic_core.errors import ConfigError

if TYPE_CHECKING:
    from physic_core.cache.lru_folder import CacheFile


@click.group()
def cache() -> None:
    """Show or clear the cache: outputs of backends, correspondences of body meshes, optimised networks, hashes of
    files."""


@cache.command()
def info() -> None:
    """Print the cache folders, and the number and size of cached files for each backend."""
    from physic_core.cache.lru_folder import list_files

    folder = _folder()
    files = list_files(folder)
    echo(f"{folder}: {_sum(files)}")
    for line in _by_backend(files):
        echo(line)
    for place, suffix, what in _other_caches():
        if files := list_files(place, suffix):
            echo(f"{place}: {_sum(files, what)}")


@cache.command()
def clear() -> None:
    """Delete all cached files and print what was deleted; results of runs are kept."""
    from physic_core.cache.lru_folder import clear_folder as remove

    folder = _folder()
    files = remove(folder)
    for line in _by_backend(files):
        echo(line)
    echo(f"removed {_sum(files)} from {folder}")
    for place, suffix, what in _other_caches():
        if files := remove(place, suffix):
            echo(f"removed {_sum(files, what)} from {place}")


def _folder() -> Path:
    from physic_core.cache.folders import CACHE_VARIABLE, results_folder

    folder = results_folder()
    if folder is None:
        raise ConfigError(
            f"the cache is switched off by the environment variable {CACHE_VARIABLE}: unset it to see the cache"
        )
    return folder


def _by_backend(files: Iterable[CacheFile]) -> list[str]:
    """Format one line with number and size of files for each interface and backend."""
    groups: dict[tuple[str, str], list[CacheFile]] = {}
    for file in files:
        interface, _, rest = file.path.name.partition("-")
        groups.setdefault((interface, rest.rpartition("-")[0]), []).append(file)
    width = max((len(backend) for _, backend in groups), default=0)
    return [
        f"  {interface:<17}  {backend:<{width}}  {len(group):>6}  {_size(group):>10}"
        for (interface, backend), group in sorted(groups.items())
    ]


def _other_caches() -> list[tuple[Path, str, tuple[str, str]]]:
    """Return folder, file suffix, and singular and plural name of the other caches."""
    from physic_core.cache.lru_folder import GRAPH_SUFFIX, HASH_SUFFIX, MAP_SUFFIX

    kinds = (
        (correspondences_folder(), MAP_SUFFIX, ("map between bodies", "maps between bodies")),
        (graphs_folder(), GRAPH_SUFFIX, ("optimised network", "optimised networks")),
        (hashes_folder(), HASH_SUFFIX, ("hash of a file", "hashes of files")),
    )
    return [(place, suffix, names) for place, suffix, names in kinds if place is not None]


def _sum(files: list[CacheFile], names: tuple[str, str] = ("answer", "answers")) -> str:
    return f"{len(files)} {names[len(files) != 1]}, {_size(files)}"


def _size(files: Iterable[CacheFile]) -> str:
    return f"{sum(file.size for file in files) / 1e6:.1f} MB"
