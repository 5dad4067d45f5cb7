"""The commands ``physic weights`` and ``physic cache``.

They list and verify the weights of installed plugins, and show and clear the cache; physic-setup adds ``fetch``.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING, Any

import click

from physic_core.cache.folders import CACHE_VARIABLE, CACHES, users_cache
from physic_core.cli.exit_codes import WEIGHTS
from physic_core.cli.groups import ExtensibleGroup
from physic_core.cli.output import echo, echo_json, format_table
from physic_core.errors import ConfigError

if TYPE_CHECKING:
    from physic_core.cache.folders import CacheFile, LruFolder
    from physic_core.weights.library import ListedWeights

_JSON = click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
_USE = {True: "yes", False: "NO", None: "not stated"}


@click.group(cls=ExtensibleGroup, path="weights")
def weights() -> None:
    """List, download and verify the weights that plugins need.

    The folders in PHYSIC_WEIGHTS, your cache folder and the cache of Hugging Face are searched. Only `fetch` uses the
    network.
    """


@weights.command("list")
@click.option("--missing", is_flag=True, help="Only sets that are missing, incomplete or of unexpected size.")
@_JSON
def list_weights(missing: bool, as_json: bool) -> None:
    """List all weight sets: plugin, size, licence, and whether they are on this machine.

    With --json, also their files with sources, SHA-256 and paths on this machine.
    """
    from physic_core.weights.library import read_library

    library = read_library()
    sets = [one for one in library.sets if not (missing and _state(one) == "here")]
    if as_json:
        broken = [{"distribution": offer.distribution, "cause": why} for offer, why in library.broken]
        echo_json({"sets": [_as_dict(one) for one in sets], "broken": broken})
        return
    rows = [("weights", "plugin", "size", "commercial use", "account", "state", "licence")]
    for one in sets:
        found = one.weights
        account = "needed" if found.needs_account else "-"
        rows.append(
            (
                *(found.name, one.offer.distribution, _size(found.bytes), _USE[found.commercial], account),
                *(_state(one), found.license),
            )
        )
    for offer, why in library.broken:
        rows.append(("-", offer.distribution, "-", "-", "-", "BROKEN", " ".join(why.split())))
    echo(format_table(rows) if len(rows) > 1 else "nothing is missing" if missing else "no plugin lists weights")


@weights.command()
@click.argument("names", nargs=-1, metavar="[NAME...]")
@_JSON
@click.pass_context
def verify(ctx: click.Context, names: tuple[str, ...], as_json: bool) -> None:
    """Compare the files of all weight sets, or of the sets NAME..., with their published sizes and SHA-256.

    A file without a published SHA-256 is compared with that of the lock file. Exits with code 4 if a file differs, or
    if a file of a set NAME is missing.
    """
    from physic_core.weights.find import describe_mismatch, locate_files
    from physic_core.weights.library import read_library
    from physic_core.weights.lock import locked

    library = read_library()
    rows: list[dict[str, str]] = []
    for one in [library.get(name) for name in dict.fromkeys(names)] or library.sets:
        here = locate_files(one.weights)
        for file in locked(one.weights).files:
            path = here.get(file.path)
            entry = {"weights": one.weights.name, "file": file.path, "path": str(path or "")}
            if path is None:
                if names:
                    rows.append(entry | {"state": "missing", "note": ""})
                continue
            wrong = describe_mismatch(path, file)
            compared = [word for word, known in (("size", file.bytes), ("SHA-256", file.sha256)) if known is not None]
            note = wrong or (
                ""
                if "SHA-256" in compared
                else f"{'only the size' if compared else 'neither size nor SHA-256'} is published"
            )
            rows.append(entry | {"state": "DIFFERS" if wrong else "ok", "note": note})
            if not as_json:
                _echo_row(rows[-1])
    if as_json:
        echo_json(rows)
    else:
        for row in rows:
            if row["state"] == "missing":
                _echo_row(row)
        count = {state: sum(row["state"] == state for row in rows) for state in ("ok", "DIFFERS", "missing")}
        files = "1 file" if len(rows) == 1 else f"{len(rows)} files"
        echo(f"{files}: {count['ok']} ok, {count['DIFFERS']} differ, {count['missing']} missing")
    ctx.exit(WEIGHTS if any(row["state"] != "ok" for row in rows) else 0)


def _echo_row(row: dict[str, str]) -> None:
    end = f": {row['note']}" if row["note"] else ""
    echo(f"{row['state']:<8} {row['weights']} {row['file']}{end}")


def _state(one: ListedWeights) -> str:
    """Return whether a weight set is missing, incomplete or present; compares sizes, not hashes."""
    from physic_core.weights.find import locate_files

    here = locate_files(one.weights)
    if not here:
        return "missing"
    if len(here) < len(one.weights.files):
        return "in part"
    sizes = [file.bytes in (None, here[file.path].stat().st_size) for file in one.weights.files]
    return "here" if all(sizes) else "here, DIFFERS"


def _as_dict(one: ListedWeights) -> dict[str, Any]:
    from dataclasses import asdict

    from physic_core.weights.find import locate_files

    here = locate_files(one.weights)
    table = asdict(one.weights)
    files = [entry | {"here": str(here.get(entry["path"], ""))} for entry in table.pop("files")]
    owner = {"distribution": one.offer.distribution, "version": one.offer.version}
    return {"plugin": owner, **table, "bytes": one.weights.bytes, "state": _state(one), "files": files}


def _size(size: int | None) -> str:
    from physic_core.weights.find import format_size

    return format_size(size) or "-"


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
