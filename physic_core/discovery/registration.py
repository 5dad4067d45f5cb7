"""Register installed plugins with one pluggy manager, and call their hooks one by one.

pluggy's own loader and its calls of a hook stop at the first plugin that fails. Here, a plugin that fails is an
:class:`Answer` with its error, and the others are called. ``physic --help`` imports this module, so it imports little.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any

import pluggy

from physic_core.discovery import hookspecs
from physic_core.discovery.plugin_code import plugin_code
from physic_core.discovery.records import RECORD_HOOKS, BackendRecord

PLUGINS_GROUP = "physic.plugins"
ENERGIES_GROUP = "physic.energies"
EXECUTORS_GROUP = "physic.executors"
PAGES_GROUP = "physic.pages"
ENTRY_POINT_GROUPS = (PLUGINS_GROUP, ENERGIES_GROUP, EXECUTORS_GROUP, PAGES_GROUP)
"""All groups of entry points that are read; only modules of the first have hooks."""

PLUGINS_VARIABLE = "PHYSIC_PLUGINS"
WEIGHTS_HOOK = "physic_weights"
_RECORDS: dict[str, type[Any]] = {"physic_backends": BackendRecord} | {
    hook: kind for kind, hook in RECORD_HOOKS.items()
}
_HOOKS = (*_RECORDS, WEIGHTS_HOOK)


class InvalidPluginError(Exception):
    """A plugin can be imported, but violates the hook specification."""


@dataclass(frozen=True)
class Answer:
    """What one plugin returns from a hook.

    Attributes:
        plugin: name of the plugin in the manager.
        returned: a list of records, or a path; None if there is an error.
        error: raised by the plugin, or an :class:`InvalidPluginError` about what it returns.
    """

    plugin: str
    returned: Any = None
    error: Exception | None = None


@dataclass(frozen=True)
class RegisteredPlugins:
    """The plugins of one discovery.

    Attributes:
        manager: pluggy's; its ``HookImpl.plugin_name`` are the keys of ``entries``.
        entries: entry point of each plugin by its name in the manager.
        rejected: plugins that cannot be registered, and the error.
        seconds: time to import each plugin and call its hooks.
    """

    manager: pluggy.PluginManager
    entries: dict[str, EntryPoint] = field(default_factory=dict)
    rejected: list[tuple[EntryPoint, Exception]] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)


def select_entry_points(
    group: str, installed: Iterable[EntryPoint] | None, environment: Mapping[str, str]
) -> tuple[list[EntryPoint], list[str]]:
    """Return the entry points of a group, and the names in ``PHYSIC_PLUGINS`` that are not installed.

    Args:
        group: one of :data:`ENTRY_POINT_GROUPS`.
        installed: entry points; None for those of this Python.
        environment: if it has ``PHYSIC_PLUGINS=a,b``, only distributions of which the name, a package or an entry
            point has one of these names are kept; none if it is empty.
    """
    from physic_core.discovery.offers import canonicalize_name

    asked = environment.get(PLUGINS_VARIABLE)
    names = None
    if asked is not None:
        names = {canonicalize_name(name.strip()): name.strip() for name in asked.split(",") if name.strip()}
    read = (group,) if names is None else ENTRY_POINT_GROUPS
    if installed is None:
        found = [entry for each in read for entry in entry_points(group=each)]
    else:
        found = [entry for entry in installed if entry.group in read]
    if names is None:
        return found, []
    kept, fitting = set(), set()
    for entry in found:
        package = module_of(entry).partition(".")[0]
        own = {canonicalize_name(n) for n in (entry.name, package, distribution_of(entry)[0])}
        if own & names.keys():
            kept.add(distribution_of(entry))
            fitting |= own
    return (
        [entry for entry in found if entry.group == group and distribution_of(entry) in kept],
        [text for name, text in names.items() if name not in fitting],
    )


def register_plugins(
    entries: Iterable[EntryPoint], clock: Callable[[], float] = time.perf_counter
) -> RegisteredPlugins:
    """Import plugins and register their hooks; a plugin that fails is listed in ``rejected``.

    Args:
        entries: of the group ``physic.plugins``.
        clock: returns the time in seconds.
    """
    manager = pluggy.PluginManager(hookspecs.PROJECT)
    manager.add_hookspecs(hookspecs)
    plugins = RegisteredPlugins(manager)
    for entry in sorted(entries, key=lambda each: (each.value, each.name)):
        start = clock()
        try:
            # Output of a plugin must not mix with the output of a command.
            with plugin_code(), redirect_stdout(sys.stderr):
                name = _register(plugins, entry)
        except Exception as error:
            plugins.rejected.append((entry, error))
        else:
            plugins.entries[name] = entry
            plugins.seconds[name] = clock() - start
    return plugins


def _register(plugins: RegisteredPlugins, entry: EntryPoint) -> str:
    manager, written = plugins.manager, f"{entry.name} = {entry.value}"
    module: object = None
    if all(part.strip().isidentifier() for part in entry.value.partition("[")[0].split(".")):
        module = entry.load()
    if not isinstance(module, ModuleType):
        raise InvalidPluginError(f"its entry point '{written}' should name a module: '{entry.name} = my_pkg'")
    if (twin := manager.get_name(module)) is not None:
        owner = distribution_of(plugins.entries[twin])[0]
        raise InvalidPluginError(f"its module {entry.value} is registered already, by '{twin}' of {owner}")
    try:
        manager.register(module, written)
    except pluggy.PluginValidationError as error:  # such as a hook with an argument
        raise InvalidPluginError("; ".join(str(error).splitlines()[1:]) or str(error)) from error
    callers = manager.get_hookcallers(module) or []
    if unknown := [caller.name for caller in callers if not caller.has_spec()]:
        manager.unregister(module)
        raise InvalidPluginError(
            f"there is no hook named {unknown[0]!r}; there are {', '.join(repr(name) for name in _HOOKS)}"
        )
    if not callers:
        raise InvalidPluginError(f"{entry.value} has no function physic_backends marked with @hookimpl")
    return written


def call_hook(
    plugins: RegisteredPlugins, hook: str, clock: Callable[[], float] = time.perf_counter
) -> Iterator[Answer]:
    """Call a hook of all registered plugins, and yield the answer of each.

    Args:
        plugins: the registered plugins, whose ``seconds`` are increased.
        hook: "physic_backends", "physic_commands", "physic_exporters" or "physic_weights".
        clock: returns the time in seconds.
    """
    for implementation in getattr(plugins.manager.hook, hook).get_hookimpls():
        start, name = clock(), implementation.plugin_name
        try:
            with plugin_code(), redirect_stdout(sys.stderr):
                returned = implementation.function()
                if problem := _problem(hook, returned):
                    raise InvalidPluginError(f"{hook}() {problem}")
            yield Answer(name, returned)
        except Exception as error:
            yield Answer(name, error=error)
        plugins.seconds[name] += clock() - start


def _problem(hook: str, returned: object) -> str:
    """Return why a plugin may not return this from a hook; empty if it may."""
    if hook == WEIGHTS_HOOK:
        if not isinstance(returned, (str, os.PathLike)):
            return f"must return the path of a TOML file or folder, got {type(returned).__name__}"
        return "" if os.path.exists(returned) else f"names {os.fspath(returned)}, which does not exist"
    kind = _RECORDS[hook]
    if isinstance(returned, (list, tuple)) and all(isinstance(record, kind) for record in returned):
        return ""
    return f"must return a list of {kind.__name__}, got {_describe_type(returned, kind)}"


def _describe_type(returned: object, kind: type) -> str:
    if isinstance(returned, (list, tuple)):
        others = sorted({type(r).__name__ for r in returned if not isinstance(r, kind)})
        return f"a {type(returned).__name__} with {', '.join(others)} in it"
    return type(returned).__name__


def module_of(entry: EntryPoint) -> str:
    """Return the name of the module of an entry point."""
    return entry.value.partition(":")[0].strip()


def distribution_of(entry: EntryPoint) -> tuple[str, str]:
    """Return name and version of an entry point's distribution; (entry name, "") if it has no metadata."""
    found = entry.dist.metadata if entry.dist is not None else None
    if found is None or not found["Name"]:
        return entry.name, ""
    return found["Name"], found["Version"] or ""
