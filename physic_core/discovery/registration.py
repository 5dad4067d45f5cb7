"""Load the entry points of plugins, and call their hooks.

pluggy's own loader stops at the first broken plugin, and does not report which plugin returned a record. So each entry
point has its own plugin manager here. ``physic --help`` imports this module, so it imports little.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any, TypeVar

import pluggy

from physic_core.discovery import hookspecs
from physic_core.discovery.records import RECORD_HOOKS

PLUGINS_GROUP = "physic.plugins"
ENERGIES_GROUP = "physic.energies"
EXECUTORS_GROUP = "physic.executors"
MOMENTS_GROUP = "physic.moments"
PAGES_GROUP = "physic.pages"
ENTRY_POINT_GROUPS = (PLUGINS_GROUP, ENERGIES_GROUP, EXECUTORS_GROUP, MOMENTS_GROUP, PAGES_GROUP)
"""All groups of entry points that are read; only modules of the first have hooks."""

PLUGINS_VARIABLE = "PHYSIC_PLUGINS"
_Record = TypeVar("_Record")
_HOOKS = ("physic_backends", *RECORD_HOOKS.values(), "physic_weights")


class InvalidPluginError(Exception):
    """A plugin can be imported, but violates the hook specification."""


class _PluginManager(pluggy.PluginManager):
    """Looks for hooks among the functions of a plugin alone.

    pluggy before 1.7 reads every name that ``dir`` lists, and so executes the ``__getattr__`` of a module, which may
    import something heavy; later versions look at every name slowly.
    """

    def parse_hookimpl_opts(self, plugin: object, name: str) -> pluggy.HookimplOpts | None:
        found = vars(plugin).get(name) if isinstance(plugin, ModuleType) else inspect.getattr_static(plugin, name, None)
        if not inspect.isroutine(found):
            return None
        return super().parse_hookimpl_opts(plugin, name)


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
    names = requested_plugins(environment)
    read = (group,) if names is None else ENTRY_POINT_GROUPS
    if installed is None:
        found = [entry for each in read for entry in entry_points(group=each)]
    else:
        found = [entry for entry in installed if entry.group in read]
    if names is None:
        return found, []
    from physic_core.discovery.offers import canonicalize_name

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


def requested_plugins(environment: Mapping[str, str]) -> dict[str, str] | None:
    """Return the names in ``PHYSIC_PLUGINS``, by canonical name, or None if it is not set."""
    restriction = environment.get(PLUGINS_VARIABLE)
    if restriction is None:
        return None
    from physic_core.discovery.offers import canonicalize_name

    return {canonicalize_name(n.strip()): n.strip() for n in restriction.split(",") if n.strip()}


def load_plugin(entry: EntryPoint) -> pluggy.PluginManager:
    """Import one plugin and check its hooks.

    Raises:
        InvalidPluginError: it names no module, or has an unknown hook or none.
    """
    manager = _PluginManager(hookspecs.PROJECT)
    manager.add_hookspecs(hookspecs)
    if not all(part.strip().isidentifier() for part in entry.value.partition("[")[0].replace(":", ".").split(".")):
        raise InvalidPluginError(
            f"its entry point '{entry.name} = {entry.value}' should name a module: '{entry.name} = my_pkg'"
        )
    module = entry.load()
    manager.register(module, name=entry.name)
    try:
        manager.check_pending()
    except pluggy.PluginValidationError as error:
        unknown = [n for n, h in vars(manager.hook).items() if not n.startswith("_") and not h.has_spec()]
        raise InvalidPluginError(
            f"there is no hook named {unknown[0]!r}; there are {', '.join(repr(name) for name in _HOOKS)}"
        ) from error
    if not any(getattr(manager.hook, hook).get_hookimpls() for hook in _HOOKS):
        raise InvalidPluginError(f"{entry.value} has no function physic_backends marked with @hookimpl")
    return manager


def records_of_hook(manager: pluggy.PluginManager, hook: str, kind: type[_Record]) -> list[_Record]:
    """Call a hook of one plugin, and return its list of records.

    Raises:
        InvalidPluginError: the hook does not return a list of records of class ``kind``.
    """
    records: list[_Record] = []
    for implementation in getattr(manager.hook, hook).get_hookimpls():
        returned: Any = implementation.function()
        if not isinstance(returned, (list, tuple)) or not all(isinstance(r, kind) for r in returned):
            raise InvalidPluginError(
                f"{hook}() must return a list of {kind.__name__}, got {_describe_type(returned, kind)}"
            )
        records += returned
    return records


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
