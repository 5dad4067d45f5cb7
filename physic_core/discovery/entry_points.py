"""Call the hooks of all installed plugins; collect backends, lists of weights and broken plugins."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_core.discovery.claims import BrokenPlugin, Claim, Manifest, Origin, problem_of
from physic_core.discovery.error_text import describe
from physic_core.discovery.records import BackendRecord, CommandRecord
from physic_core.discovery.registration import (
    RESTRICT,
    BadPluginError,
    distribution_of,
    load_plugin,
    module_of,
    records_of,
    selected,
)

if TYPE_CHECKING:
    import pluggy

__all__ = ["Found", "find", "origin_of"]


@dataclass(frozen=True)
class Found:
    """Results of the hooks of all installed plugins.

    Attributes:
        claims: backends.
        broken: plugins that failed, completely or in part.
        manifests: lists of weights, unread.
        restriction: value of ``PHYSIC_PLUGINS``, which hides all other plugins; None if it is not set.
    """

    claims: tuple[Claim, ...] = ()
    broken: tuple[BrokenPlugin, ...] = ()
    manifests: tuple[Manifest, ...] = ()
    restriction: str | None = None


def find(
    installed: Iterable[EntryPoint] | None = None,
    *,
    environment: Mapping[str, str] = os.environ,
    clock: Callable[[], float] = time.perf_counter,
) -> Found:
    """Call the hooks of every installed plugin. A broken plugin is listed in ``broken`` and raises nothing.

    Args:
        installed: entry points; None for those of this Python.
        environment: if it has ``PHYSIC_PLUGINS=a,b``, only the distributions or entry points of these names are
            imported; none if it is empty.
        clock: seconds.
    """
    entries, unknown = selected(installed, environment)
    broken = [BrokenPlugin(Origin("", name), f"named in {RESTRICT} but not installed") for name in unknown]
    claims: list[Claim] = []
    manifests: list[Manifest] = []
    for entry in sorted(entries, key=lambda e: (distribution_of(e)[0], e.name)):
        start = clock()
        try:
            # Output of a plugin must not mix with the output of a command.
            with redirect_stdout(sys.stderr):
                manager = load_plugin(entry)
                records = records_of(manager, "physic_backends", BackendRecord)
                records_of(manager, "physic_commands", CommandRecord)  # only checked here
                weights, complaints = _manifests(manager, entry)
            origin = origin_of(entry, clock() - start)
            claims += [Claim(record, origin, problem_of(record, origin)) for record in records]
            manifests += [Manifest(origin, path) for path in weights]
            broken += [BrokenPlugin(origin, *complaint) for complaint in complaints]
        # SystemExit too: a plugin that calls sys.exit() at import must not end `physic plugins`.
        except (Exception, SystemExit) as error:
            cause = str(error) if isinstance(error, BadPluginError) else describe(error, module_of(entry))
            broken.append(BrokenPlugin(origin_of(entry), cause, error))
    return Found(tuple(claims), tuple(broken), tuple(manifests), environment.get(RESTRICT))


def origin_of(entry: EntryPoint, seconds: float = 0.0) -> Origin:
    """The plugin of an entry point; reads the metadata of its distribution."""
    distribution, number = distribution_of(entry)
    return Origin(module_of(entry), distribution, number, seconds)


def _manifests(
    manager: pluggy.PluginManager, entry: EntryPoint
) -> tuple[list[Path], list[tuple[str, BaseException | None]]]:
    """Lists of weights of one plugin, unread, and the errors of invalid ones; its backends are kept."""
    paths: list[Path] = []
    complaints: list[tuple[str, BaseException | None]] = []
    for implementation in manager.hook.physic_weights.get_hookimpls():
        try:
            returned: Any = implementation.function()
        except (Exception, SystemExit) as error:
            complaints.append((f"physic_weights() fails: {describe(error, module_of(entry))}", error))
            continue
        if not isinstance(returned, (str, os.PathLike)):
            kind = type(returned).__name__
            complaints.append((f"physic_weights() must return the path of a TOML file or folder, got {kind}", None))
        elif not os.path.exists(returned):
            complaints.append((f"physic_weights() names {os.fspath(returned)}, which does not exist", None))
        else:
            paths.append(Path(returned))
    return paths, complaints
