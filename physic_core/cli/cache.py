"""``physic cache``: show and clear the cache."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import click

from physic_core.cache.folders import CACHE_VARIABLE, CACHES, users_cache
from physic_core.cli.output import echo
from physic_core.errors import ConfigError

if TYPE_CHECKING:
    from physic_core.cache.lru_folder import CacheFile, LruFolder

_NAMES = {
    "results": ("result", "results"),
    "correspondences": ("mesh correspondence", "mesh correspondences"),
    "graphs": ("optimised network", "optimised networks"),
    "hashes": ("file hash", "file hashes"),
}


@click.group()
def cache() -> None:
    """Show or clear the cache: outputs of backends, correspondences of body meshes, optimised networks, hashes of
    files."""


@cache.command()
def info() -> None:
    """Print the cache folders, and the number and size of cached files for each backend."""
    for name, kept in _caches().items():
        files = kept.files()
        if files or name == "results":
            echo(f"{kept.path}: {_sum(files, name)}")
        for line in _by_backend(files) if name == "results" else ():
            echo(line)


@cache.command()
def clear() -> None:
    """Delete all cached files and print what was deleted; results of runs are kept."""
    for name, kept in _caches().items():
        files = kept.clear()
        for line in _by_backend(files) if name == "results" else ():
            echo(line)
        if files or name == "results":
            echo(f"removed {_sum(files, name)} from {kept.path}")


def _caches() -> dict[str, LruFolder]:
    found = {name: kept for name in CACHES if (kept := users_cache(name)) is not None}
    if not found:
        raise ConfigError(
            f"the cache is disabled by the environment variable {CACHE_VARIABLE}: unset it to see the cache"
        )
    return found


def _by_backend(files: Iterable[CacheFile]) -> list[str]:
    """Format one line with the number and size of files for each interface and backend."""
    groups: dict[tuple[str, str], list[CacheFile]] = {}
    for file in files:
        interface, _, rest = file.path.name.partition("-")
        groups.setdefault((interface, rest.rpartition("-")[0]), []).append(file)
    width = max((len(backend) for _, backend in groups), default=0)
    return [
        f"  {interface:<17}  {backend:<{width}}  {len(group):>6}  {_size(group):>10}"
        for (interface, backend), group in sorted(groups.items())
    ]


def _sum(files: list[CacheFile], name: str) -> str:
    return f"{len(files)} {_NAMES[name][len(files) != 1]}, {_size(files)}"


def _size(files: Iterable[CacheFile]) -> str:
    return f"{sum(file.size for file in files) / 1e6:.1f} MB"
