"""Find the executors that installed plugins add to ``physic batch``."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from contextlib import redirect_stdout, suppress
from importlib.metadata import EntryPoint
from typing import NamedTuple

from physic_core.discovery.catalog import EXECUTORS, how_to_install
from physic_core.discovery.plugin_code import plugin_code
from physic_core.discovery.records import ExecutorRecord
from physic_core.discovery.registration import (
    PLUGINS_VARIABLE,
    call_hook,
    distribution_of,
    load_plugin,
    select_entry_points,
)
from physic_core.errors import ConfigError

__all__ = ["InstalledExecutor", "find_executor", "find_executors"]


class InstalledExecutor(NamedTuple):
    """The record of an executor, and the distribution that adds it."""

    record: ExecutorRecord
    distribution: str


def find_executors(
    installed: Iterable[EntryPoint] | None = None, *, environment: Mapping[str, str] = os.environ
) -> tuple[InstalledExecutor, ...]:
    """Call the hook ``physic_executors`` of every installed plugin; broken plugins are skipped.

    Args:
        installed: entry points; None for those of this Python.
        environment: may restrict the plugins with ``PHYSIC_PLUGINS``.
    """
    found: list[InstalledExecutor] = []
    for entry in sorted(select_entry_points(installed, environment)[0], key=lambda e: e.value):
        with suppress(Exception), plugin_code(), redirect_stdout(sys.stderr):
            records = call_hook(load_plugin(entry), "physic_executors", ExecutorRecord)
            found += [InstalledExecutor(record, distribution_of(entry)[0]) for record in records]
    return tuple(found)


def find_executor(
    name: str,
    own: Iterable[str] = (),
    installed: Iterable[EntryPoint] | None = None,
    *,
    environment: Mapping[str, str] = os.environ,
) -> InstalledExecutor:
    """Return the executor of a plugin by its name.

    Args:
        name: of the executor.
        own: names of the core's executors, for the message.
        installed: entry points; None for those of this Python.
        environment: may restrict the plugins with ``PHYSIC_PLUGINS``.

    Raises:
        ConfigError: no plugin, or more than one, offers the name; the message lists what is installed.
    """
    found = find_executors(installed, environment=environment)
    fitting = [executor for executor in found if executor.record.name == name]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        owners = " and ".join(executor.distribution for executor in fitting)
        raise ConfigError(f"the executor '{name}' is offered by {owners}: uninstall one of them")
    names = ", ".join([*own, *(executor.record.name for executor in found)])
    hint = f". '{name}' comes with {EXECUTORS[name]}: {how_to_install(EXECUTORS[name])}" if name in EXECUTORS else ""
    if environment.get(PLUGINS_VARIABLE) is not None:
        hint += f" ({PLUGINS_VARIABLE}='{environment[PLUGINS_VARIABLE]}' hides other plugins)"
    raise ConfigError(f"no executor named '{name}'; installed: {names}{hint}")
