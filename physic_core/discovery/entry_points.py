"""Call the hooks of all installed plugins, and collect their backends, weight manifests and errors."""

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

from physic_core.discovery.error_text import describe_error
from physic_core.discovery.offers import BackendOffer, BrokenPlugin, Manifest, Origin, backend_record_problem
from physic_core.discovery.plugin_code import plugin_code
from physic_core.discovery.records import RECORD_HOOKS, BackendRecord
from physic_core.discovery.registration import (
    PLUGINS_GROUP,
    PLUGINS_VARIABLE,
    InvalidPluginError,
    distribution_of,
    load_plugin,
    module_of,
    records_of_hook,
    select_entry_points,
)

if TYPE_CHECKING:
    import pluggy


@dataclass(frozen=True)
class FoundPlugins:
    """Backends, weight manifests and errors of all installed plugins.

    Attributes:
        offers: the backends.
        broken: plugins with errors.
        manifests: paths of weight manifests; they are not read.
        restriction: value of ``PHYSIC_PLUGINS``, which hides all other plugins; None if it is not set.
    """

    offers: tuple[BackendOffer, ...] = ()
    broken: tuple[BrokenPlugin, ...] = ()
    manifests: tuple[Manifest, ...] = ()
    restriction: str | None = None


def find_plugins(
    installed: Iterable[EntryPoint] | None = None,
    *,
    environment: Mapping[str, str] = os.environ,
    clock: Callable[[], float] = time.perf_counter,
) -> FoundPlugins:
    """Call the hooks of every installed plugin; list broken plugins instead of raising an error.

    Args:
        installed: entry points; None for those of this Python.
        environment: if it has ``PHYSIC_PLUGINS=a,b``, only the distributions of these names are imported; none
            if it is empty.
        clock: returns the time in seconds.
    """
    entries, unknown = select_entry_points(PLUGINS_GROUP, installed, environment)
    broken = [BrokenPlugin(Origin("", name), f"named in {PLUGINS_VARIABLE} but not installed") for name in unknown]
    offers: list[BackendOffer] = []
    manifests: list[Manifest] = []
    for entry in sorted(entries, key=lambda e: (distribution_of(e)[0], e.name)):
        start = clock()
        try:
            # Output of a plugin must not mix with the output of a command.
            with plugin_code(), redirect_stdout(sys.stderr):
                manager = load_plugin(entry)
                records = records_of_hook(manager, "physic_backends", BackendRecord)
                for kind, hook in RECORD_HOOKS.items():
                    records_of_hook(manager, hook, kind)  # only checked here
                weights, complaints = _manifests(manager, entry)
            origin = origin_of(entry, clock() - start)
            offers += [BackendOffer(record, origin, backend_record_problem(record, origin)) for record in records]
            manifests += [Manifest(origin, path) for path in weights]
            broken += [BrokenPlugin(origin, *complaint) for complaint in complaints]
        except Exception as error:
            cause = str(error) if isinstance(error, InvalidPluginError) else describe_error(error, module_of(entry))
            broken.append(BrokenPlugin(origin_of(entry), cause, error))
    return FoundPlugins(tuple(offers), tuple(broken), tuple(manifests), environment.get(PLUGINS_VARIABLE))


def origin_of(entry: EntryPoint, seconds: float = 0.0) -> Origin:
    """Return the plugin of an entry point; reads the metadata of its distribution."""
    distribution, number = distribution_of(entry)
    return Origin(module_of(entry), distribution, number, seconds)


def _manifests(
    manager: pluggy.PluginManager, entry: EntryPoint
) -> tuple[list[Path], list[tuple[str, BaseException | None]]]:
    """Return the paths of a plugin's weight manifests, and the errors of its hook ``physic_weights``."""
    paths: list[Path] = []
    complaints: list[tuple[str, BaseException | None]] = []
    for implementation in manager.hook.physic_weights.get_hookimpls():
        try:
            with plugin_code():
                returned: Any = implementation.function()
        except Exception as error:
            complaints.append((f"physic_weights() fails: {describe_error(error, module_of(entry))}", error))
            continue
        if not isinstance(returned, (str, os.PathLike)):
            kind = type(returned).__name__
            complaints.append((f"physic_weights() must return the path of a TOML file or folder, got {kind}", None))
        elif not os.path.exists(returned):
            complaints.append((f"physic_weights() names {os.fspath(returned)}, which does not exist", None))
        else:
            paths.append(Path(returned))
    return paths, complaints
