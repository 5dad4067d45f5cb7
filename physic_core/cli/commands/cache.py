"""The command ``physic cache``: show, fill and clear the cache."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

import click

from physic_core.cache.folders import CACHE_VARIABLE, CACHES, users_cache
from physic_core.cli.arguments import configuration_options
from physic_core.cli.output import echo
from physic_core.errors import ConfigError

if TYPE_CHECKING:
    from physic_core.cache.folders import CacheFile, LruFolder


@click.group()
def cache() -> None:
    """Show, fill or clear the cache: outputs of backends, correspondences of body meshes, optimized
    networks, hashes of files.
    """


@cache.command()
def info() -> None:
    """Print the cache folders, and the number and size of their files."""
    for name in CACHES:
        kept = _cache(name)
        echo(f"{kept.path}: {_count_and_size(kept.files())}")
    echo(f"`physic cache clear {' '.join(CACHES)}` deletes all, or those that you name")


@cache.command()
@configuration_options
def fill(file: Path | None, preset: str | None, overrides: tuple[str, ...]) -> None:
    """Optimize the networks of a configuration, and keep them.

    onnxruntime optimizes each network for this processor. One is open at a time.
    """
    from physic_core.configuration.model import load_config
    from physic_core.pipeline.run import Pipeline

    graphs = _cache("graphs")
    one_at_a_time = (*overrides, "run.low_memory=true")
    with Pipeline(load_config(file, preset=preset, overrides=one_at_a_time)) as pipeline:
        pipeline.warm_up()
    echo(f"{graphs.path}: {_count_and_size(graphs.files())}")


@cache.command()
@click.argument("names", nargs=-1, metavar="[NAME...]", type=click.Choice(tuple(CACHES)))
def clear(names: tuple[str, ...]) -> None:
    """Delete all cached files, or those of the caches NAME.

    Results of runs are kept. The caches are results (of backends), correspondences, graphs
    (optimized networks), hashes and kit (backends that passed `physic plugins check`).
    """
    for name in names or CACHES:
        kept = _cache(name)
        echo(f"removed {_count_and_size(kept.clear())} from {kept.path}")


def _cache(name: str) -> LruFolder:
    kept = users_cache(name)
    if kept is None:
        raise ConfigError(
            f"the cache is disabled by the environment variable {CACHE_VARIABLE}: unset it to use "
            f"the cache"
        )
    return kept


def _count_and_size(files: Collection[CacheFile]) -> str:
    return f"{len(files)} files, {sum(file.size for file in files) / 1e6:.1f} MB"
