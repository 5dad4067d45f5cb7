"""``physic cache``: show and clear the cache."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING

import click

from physic_core.cache.folders import CACHE_VARIABLE, CACHES, users_cache
from physic_core.cli.output import echo, format_table
from physic_core.errors import ConfigError

if TYPE_CHECKING:
    from physic_core.cache.folders import CacheFile, LruFolder


@click.group()
def cache() -> None:
    """Show or clear the cache: outputs of backends, correspondences of body meshes, optimised networks, hashes of
    files."""


@cache.command()
def info() -> None:
    """Print the cache folders, and the number and size of cached files for each backend."""
    for kept in _caches():
        files = kept.files()
        echo("\n".join([f"{kept.path}: {_sum(files)}", *_by_backend(kept, files)]))


@cache.command()
def clear() -> None:
    """Delete all cached files and print what was deleted; results of runs are kept."""
    for kept in _caches():
        files = kept.clear()
        echo("\n".join([*_by_backend(kept, files), f"removed {_sum(files)} from {kept.path}"]))


def _caches() -> list[LruFolder]:
    found = [kept for name in CACHES if (kept := users_cache(name)) is not None]
    if not found:
        raise ConfigError(
            f"the cache is disabled by the environment variable {CACHE_VARIABLE}: unset it to see the cache"
        )
    return found


def _by_backend(kept: LruFolder, files: Iterable[CacheFile]) -> list[str]:
    """Format one line with the number and size of files for each interface and backend; none for other caches."""
    groups: dict[tuple[str, str], list[CacheFile]] = {}
    for file in files if kept.suffix == CACHES["results"][1] else ():
        interface, _, rest = file.path.name.partition("-")
        groups.setdefault((interface, rest.rpartition("-")[0]), []).append(file)
    rows = [(f"  {interface}", backend, _sum(group)) for (interface, backend), group in sorted(groups.items())]
    return [format_table(rows)] if rows else []


def _sum(files: Collection[CacheFile]) -> str:
    return f"{len(files)} files, {sum(file.size for file in files) / 1e6:.1f} MB"
