"""The commands ``physic weights`` and ``physic cache``.

They list and verify the weights of installed plugins, and show, fill and clear the cache;
physic-setup adds ``fetch``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

import click

from physic_core.cache.folders import CACHE_VARIABLE, CACHES, users_cache
from physic_core.cli.arguments import configuration_options
from physic_core.cli.exit_codes import WEIGHTS
from physic_core.cli.groups import ExtensibleGroup
from physic_core.cli.output import echo, format_table
from physic_core.errors import ConfigError

if TYPE_CHECKING:
    from physic_core.cache.folders import CacheFile, LruFolder

_USE = {True: "yes", False: "NO", None: "not stated"}


@click.group(cls=ExtensibleGroup, path="weights")
def weights() -> None:
    """List, download and verify the weights that plugins need.

    The folders in PHYSIC_WEIGHTS, your cache folder and the cache of Hugging Face are searched.
    Only `fetch` uses the network.
    """


@weights.command("list")
@click.option(
    "--missing", is_flag=True, help="Only sets that are missing, incomplete or of unexpected size."
)
def list_weights(missing: bool) -> None:
    """List all weight sets: plugin, size, licence, and whether they are on this machine."""
    from physic_core.weights.find import format_size, presence
    from physic_core.weights.library import read_library

    library = read_library()
    sets = [one for one in library.sets if not (missing and presence(one.weights) == "here")]
    rows = [("weights", "plugin", "size", "commercial use", "account", "state", "licence")]
    for one in sets:
        found = one.weights
        account = "needed" if found.needs_account else "-"
        rows.append(
            (
                *(
                    found.name,
                    one.offer.distribution,
                    format_size(found.bytes) or "-",
                    _USE[found.commercial],
                    account,
                ),
                *(presence(one.weights), found.license),
            )
        )
    for offer, why in library.broken:
        rows.append(("-", offer.distribution, "-", "-", "-", "BROKEN", " ".join(why.split())))
    nothing = "nothing is missing" if missing else "no plugin lists weights"
    echo(format_table(rows) if len(rows) > 1 else nothing)


@weights.command()
@click.argument("names", nargs=-1, metavar="[NAME...]")
@click.pass_context
def verify(ctx: click.Context, names: tuple[str, ...]) -> None:
    """Compare the files of all weight sets, or of the sets NAME..., with their published sizes and
    SHA-256.

    Exits with code 4 if a file differs, or if a file of a set NAME is missing.
    """
    from physic_core.weights.find import describe_mismatch, locate_files
    from physic_core.weights.library import read_library

    library = read_library()
    count = Counter[str]()
    for one in [library.get(name) for name in dict.fromkeys(names)] or library.sets:
        here = locate_files(one.weights)
        for file in one.weights.files:
            path = here.get(file.path)
            wrong = "" if path is None else describe_mismatch(path, file)
            note = wrong or ("" if file.sha256 or path is None else "no SHA-256 is published")
            state = "DIFFERS" if wrong else "ok"
            if path is None:
                state = "missing"
            if path is not None or names:
                count[state] += 1
                echo(
                    f"{state:<8} {one.weights.name} "
                    f"{path or file.path}{f': {note}' if note else ''}"
                )
    files = "1 file" if count.total() == 1 else f"{count.total()} files"
    echo(f"{files}: {count['ok']} ok, {count['DIFFERS']} differ, {count['missing']} missing")
    ctx.exit(WEIGHTS if count["DIFFERS"] or count["missing"] else 0)


@click.group()
def cache() -> None:
    """Show, fill or clear the cache: outputs of backends, correspondences of body meshes, optimised
    networks, hashes of files.
    """


@cache.command()
def info() -> None:
    """Print the cache folders, the number and size of their files, and how to delete them."""
    for name in CACHES:
        kept = _cache(name)
        echo(f"{kept.path}: {_sum(kept.files())}")
    echo(f"`physic cache clear {' '.join(CACHES)}` deletes all, or those that you name")


@cache.command()
@configuration_options
def fill(file: Path | None, preset: str | None, overrides: tuple[str, ...]) -> None:
    """Open the networks of a configuration once, so that they are kept as onnxruntime optimises
    them for this processor. One is open at a time.
    """
    from physic_core.configuration.model import load_config
    from physic_core.pipeline.run import Pipeline

    graphs = _cache("graphs")
    one_at_a_time = (*overrides, "run.low_memory=true")
    with Pipeline(load_config(file, preset=preset, overrides=one_at_a_time)) as pipeline:
        pipeline.warm_up()
    echo(f"{graphs.path}: {_sum(graphs.files())}")


@cache.command()
@click.argument("names", nargs=-1, metavar="[NAME...]", type=click.Choice(tuple(CACHES)))
def clear(names: tuple[str, ...]) -> None:
    """Delete all cached files, or those of the caches NAME..., and print what was deleted; results
    of runs are kept.

    The caches are results (of backends), correspondences, graphs (optimised networks), hashes and
    kit (backends that passed it).
    """
    for name in names or CACHES:
        kept = _cache(name)
        echo(f"removed {_sum(kept.clear())} from {kept.path}")


def _cache(name: str) -> LruFolder:
    kept = users_cache(name)
    if kept is None:
        raise ConfigError(
            f"the cache is disabled by the environment variable {CACHE_VARIABLE}: unset it to use "
            f"the cache"
        )
    return kept


def _sum(files: Collection[CacheFile]) -> str:
    return f"{len(files)} files, {sum(file.size for file in files) / 1e6:.1f} MB"
