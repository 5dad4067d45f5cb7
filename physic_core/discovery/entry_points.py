"""Call the hooks of all installed plugins, and collect their backends, weight manifests and errors."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from pathlib import Path

from physic_core.discovery.offers import BackendOffer, BrokenPlugin, Manifest, Origin, backend_record_problem
from physic_core.discovery.records import RECORD_HOOKS
from physic_core.discovery.registration import (
    PLUGINS_GROUP,
    PLUGINS_VARIABLE,
    WEIGHTS_HOOK,
    InvalidPluginError,
    call_hook,
    distribution_of,
    module_of,
    register_plugins,
    select_entry_points,
)


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
    plugins = register_plugins(entries, clock)
    # Commands and exporters are only checked here.
    answers = {
        hook: tuple(call_hook(plugins, hook, clock))
        for hook in ("physic_backends", WEIGHTS_HOOK, *RECORD_HOOKS.values())
    }
    origins = {name: origin_of(entry, plugins.seconds[name]) for name, entry in plugins.entries.items()}
    broken = [_broken(origin_of(entry), error) for entry, error in plugins.rejected]
    broken += [
        _broken(origins[answer.plugin], answer.error, f"{hook}() fails: ")
        for hook, given in answers.items()
        for answer in given
        if answer.error is not None
    ]
    return FoundPlugins(
        tuple(
            BackendOffer(record, origins[answer.plugin], backend_record_problem(record, origins[answer.plugin]))
            for answer in answers["physic_backends"]
            for record in answer.returned or ()
        ),
        (
            *(BrokenPlugin(Origin("", name), f"named in {PLUGINS_VARIABLE} but not installed") for name in unknown),
            *sorted(broken, key=lambda plugin: plugin.origin.distribution),
        ),
        tuple(
            Manifest(origins[answer.plugin], Path(answer.returned))
            for answer in answers[WEIGHTS_HOOK]
            if answer.error is None
        ),
        environment.get(PLUGINS_VARIABLE),
    )


def origin_of(entry: EntryPoint, seconds: float = 0.0) -> Origin:
    """Return the plugin of an entry point; reads the metadata of its distribution."""
    distribution, number = distribution_of(entry)
    return Origin(module_of(entry), distribution, number, seconds)


def _broken(origin: Origin, error: Exception, title: str = "") -> BrokenPlugin:
    if isinstance(error, InvalidPluginError):
        return BrokenPlugin(origin, str(error), error)
    from physic_core.discovery.error_text import describe_error

    return BrokenPlugin(origin, f"{title}{describe_error(error, origin.plugin)}", error)
