"""Load the registration modules of plugins. Only this module and hookspecs.py use pluggy.

pluggy's own loader stops at the first broken plugin and does not report which plugin returned which record. So entry
points are loaded one by one, each with its own plugin manager. ``physic --help`` imports this module, so it
imports little.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, TypeVar

import pluggy

from physic_core.discovery import hookspecs

__all__ = ["GROUP", "RESTRICT", "BadPluginError", "load_plugin", "named_plugins", "records_of", "selected"]

GROUP = "physic.plugins"
RESTRICT = "PHYSIC_PLUGINS"
_Record = TypeVar("_Record")
_HOOKS = ("physic_backends", "physic_commands", "physic_weights")


class BadPluginError(Exception):
    """A plugin that loads but violates the hook specification."""


def selected(
    installed: Iterable[EntryPoint] | None, environment: Mapping[str, str]
) -> tuple[list[EntryPoint], list[str]]:
    """The entry points to load, and the names in ``PHYSIC_PLUGINS`` that fit none of them.

    Args:
        installed: entry points; None for those of this Python.
        environment: if it has ``PHYSIC_PLUGINS=a,b``, only the distributions, modules or entry points of these names
            are selected; none if it is empty.
    """
    found = list(entry_points(group=GROUP) if installed is None else installed)
    names = named_plugins(environment)
    if names is None:
        return found, []
    from physic_core.discovery.claims import normal_name

    kept, fitting = [], set()
    for entry in found:
        own = {normal_name(n) for n in (entry.name, module_of(entry), distribution_of(entry)[0])}
        if own & names.keys():
            kept.append(entry)
            fitting |= own
    return kept, [text for name, text in names.items() if name not in fitting]


def named_plugins(environment: Mapping[str, str]) -> dict[str, str] | None:
    """The names in ``PHYSIC_PLUGINS``, by normal name; None if it is not set."""
    restriction = environment.get(RESTRICT)
    if restriction is None:
        return None
    from physic_core.discovery.claims import normal_name

    return {normal_name(n.strip()): n.strip() for n in restriction.split(",") if n.strip()}


def load_plugin(entry: EntryPoint) -> pluggy.PluginManager:
    """Import one plugin and check its hooks."""
    manager = pluggy.PluginManager(hookspecs.PROJECT)
    manager.add_hookspecs(hookspecs)
    if not all(part.strip().isidentifier() for part in entry.value.partition("[")[0].replace(":", ".").split(".")):
        raise BadPluginError(
            f"its entry point '{entry.name} = {entry.value}' should name a module: '{entry.name} = my_pkg'"
        )
    module = entry.load()
    manager.register(module, name=entry.name)
    try:
        manager.check_pending()
    except pluggy.PluginValidationError as error:
        unknown = [n for n, h in vars(manager.hook).items() if not n.startswith("_") and not h.has_spec()]
        raise BadPluginError(
            f"there is no hook named {unknown[0]!r}; there are {', '.join(repr(name) for name in _HOOKS)}"
        ) from error
    if not any(getattr(manager.hook, hook).get_hookimpls() for hook in _HOOKS):
        raise BadPluginError(f"{entry.value} has no function physic_backends marked with @hookimpl")
    return manager


def records_of(manager: pluggy.PluginManager, hook: str, kind: type[_Record]) -> list[_Record]:
    """Call a hook of one plugin that returns a list of records."""
    records: list[_Record] = []
    for implementation in getattr(manager.hook, hook).get_hookimpls():
        returned: Any = implementation.function()
        if not isinstance(returned, (list, tuple)) or not all(isinstance(r, kind) for r in returned):
            raise BadPluginError(f"{hook}() must return a list of {kind.__name__}, got {_describe(returned, kind)}")
        records += returned
    return records


def _describe(returned: object, kind: type) -> str:
    if isinstance(returned, (list, tuple)):
        others = sorted({type(r).__name__ for r in returned if not isinstance(r, kind)})
        return f"a {type(returned).__name__} with {', '.join(others)} in it"
    return type(returned).__name__


def module_of(entry: EntryPoint) -> str:
    """The module that an entry point names, or the text in its place."""
    return entry.value.partition(":")[0].strip()


def distribution_of(entry: EntryPoint) -> tuple[str, str]:
    """Name and version; an entry point made by hand has no distribution, a damaged distribution no name."""
    found = entry.dist.metadata if entry.dist is not None else None
    if found is None or not found["Name"]:
        return entry.name, ""
    return found["Name"], found["Version"] or ""
