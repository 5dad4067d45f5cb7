"""Ask the hooks of installed plugins for what they add, and import it when it is used; formats of
``physic export``.

Each plugin has a pluggy manager of its own, so a plugin that fails does not affect the others.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from types import ModuleType
from typing import Any, Generic, TypeVar

import pluggy

from physic_core.discovery import hooks
from physic_core.discovery.catalog import FORMATS, how_to_install
from physic_core.discovery.entry_points import (
    HOOKS_GROUP,
    PLUGINS_VARIABLE,
    Offer,
    canonicalize_name,
    group_problem,
    installed_offers,
    restricted_to,
)
from physic_core.discovery.error_text import describe_error, did_you_mean
from physic_core.discovery.hooks import PROJECT, RECORDS, ExporterRecord, PluginItem
from physic_core.discovery.plugin_code import named_plugin_code, plugin_code
from physic_core.errors import ConfigError, PackageMissingError, PluginError

_Record = TypeVar("_Record", bound=PluginItem | ExporterRecord)


@dataclass(frozen=True)
class FoundRecord(Generic[_Record]):
    """A record that a hook returned, and the owner of the hook."""

    record: _Record
    distribution: str
    version: str = ""

    def title(self, role: str) -> str:
        """Return "the executor 'ray' of x-ray 0.1", for messages; ``role`` is "executor"."""
        return f"the {role} '{self.record.name}' of {self.distribution} {self.version}".rstrip()


@dataclass(frozen=True)
class BrokenPlugin:
    """A plugin that cannot be imported or fails, or that has an entry point in an unknown group.

    Attributes:
        distribution: its name.
        version: of the distribution.
        cause: the failure, one line.
        error: the exception, if there was one.
    """

    distribution: str
    version: str
    cause: str
    error: BaseException | None = field(default=None, compare=False)

    def __str__(self) -> str:
        return f"{f'{self.distribution} {self.version}'.rstrip()} ({self.cause})"


def find_items(hook: str) -> tuple[FoundRecord[Any], ...]:
    """Return what all plugins return from a hook of :mod:`physic_core.discovery.hooks`; broken
    plugins are skipped.
    """
    items: list[FoundRecord[Any]] = []
    for offer in installed_offers(HOOKS_GROUP):
        with suppress(Exception):  # listed by broken_plugins
            items += [
                FoundRecord(record, offer.distribution, offer.version)
                for record in _items_of_hook(offer, hook)
            ]
    return tuple(items)


def broken_plugins() -> tuple[BrokenPlugin, ...]:
    """Return plugins with failing hooks, entry points in unknown groups, and missing plugins of
    ``PHYSIC_PLUGINS``.

    No backend is imported.
    """
    broken = []
    for offer in installed_offers(HOOKS_GROUP):
        for hook in RECORDS:
            try:
                _items_of_hook(offer, hook)
            except Exception as error:  # a plugin may raise anything
                cause = describe_error(error, offer.target)
                broken.append(BrokenPlugin(offer.distribution, offer.version, cause, error))
    for offer in installed_offers():
        if problem := group_problem(offer.group):
            broken.append(BrokenPlugin(offer.distribution, offer.version, problem))
    installed = {canonicalize_name(offer.distribution) for offer in installed_offers()}
    for name in restricted_to() or ():
        if name not in installed:
            broken.append(BrokenPlugin(name, "", f"named in {PLUGINS_VARIABLE}, and not installed"))
    return tuple({str(one): one for one in broken}.values())


def find_item(
    hook: str, name: str, role: str, *, own: str, known: Mapping[str, str]
) -> FoundRecord[PluginItem]:
    """Return the item of a name that a plugin adds.

    Args:
        hook: that returns it, such as "physic_executors".
        name: of the item.
        role: what it is, for the messages, such as "executor".
        own: name that the core itself offers, which the messages list, too.
        known: distribution of each known name.

    Raises:
        ConfigError: no plugin, or more than one, offers the name.
    """
    items = find_items(hook)
    matches = [one for one in items if one.record.name == name]
    if len(matches) == 1:
        return matches[0]
    if matches:
        owners = " and ".join(sorted(one.distribution for one in matches))
        raise ConfigError(f"the {role} '{name}' is offered by {owners}: uninstall one of them")
    if name in known:
        raise ConfigError(f"the {role} '{name}' needs {absence_message(known[name])}")
    names = sorted({own, *known, *(one.record.name for one in items)})
    raise ConfigError(
        f"no {role} named '{name}'; there are: {', '.join(names)}{did_you_mean(name, names)}"
    )


def import_item(found: FoundRecord[Any], role: str) -> Any:
    """Import the target of an item; ``role`` as in :func:`find_item`.

    Raises:
        PluginError: it cannot be imported.
    """
    module, _, attribute = found.record.target.partition(":")
    with named_plugin_code(f"{found.title(role)} cannot be imported", module, kind=PluginError):
        return getattr(import_module(module), attribute)


def import_and_call(found: FoundRecord[Any], role: str, *arguments: object) -> Any:
    """Import the function that the target of a record names, and call it with the arguments.

    Raises:
        PluginError: it cannot be imported, or fails.
        PhysicError: raised by the function itself.
    """
    function = import_item(found, role)
    with named_plugin_code(
        f"{found.title(role)} fails", found.record.target.partition(":")[0], kind=PluginError
    ):
        return function(*arguments)


def absence_message(distribution: str) -> str:
    """Return the reason why nothing of a known distribution is found, and how to install it.

    As "metricbody-ray, which is not installed: `pip install ...`".
    """
    reason = "not installed"
    if restricted_to() is not None:
        reason = f"not installed, or hidden by {PLUGINS_VARIABLE}={os.environ[PLUGINS_VARIABLE]!r}"
    if broken := [
        plugin.cause for plugin in broken_plugins() if plugin.distribution == distribution
    ]:
        reason = f"broken ({broken[0]})"
    return f"{distribution}, which is {reason}: {how_to_install(distribution)}"


def _items_of_hook(offer: Offer, hook: str) -> list[Any]:
    """Import a module of hooks, and return what one of them returns; empty if it has no such hook.

    Raises:
        Exception: the module or the hook raised it, or the hook returned something else than
            records.
    """
    kind = RECORDS[hook]
    # What a plugin prints must not mix with the output of a command.
    with plugin_code(), redirect_stdout(sys.stderr):
        relay = _relay_to(import_module(offer.target))
        records = [record for returned in getattr(relay, hook)() for record in returned]
    if wrong := [record for record in records if not isinstance(record, kind)]:
        raise PluginError(f"{hook}() should return a list of {kind.__name__}, got {wrong[0]!r}")
    return records


@lru_cache(maxsize=64)
def _relay_to(module: ModuleType) -> pluggy.HookRelay:
    """Return what calls the hooks of one module.

    Raises:
        PluginError: it has none.
        Exception: raised by pluggy for a hook that is not known.
    """
    manager = pluggy.PluginManager(PROJECT)
    manager.add_hookspecs(hooks)
    manager.register(module)
    manager.check_pending()
    if not manager.get_hookcallers(module):
        raise PluginError(f"{module.__name__} has no function marked with @hookimpl")
    return manager.hook


def find_exporters() -> tuple[FoundRecord[ExporterRecord], ...]:
    """Return the exporters of all installed plugins, sorted by name.

    Nothing of them is imported.
    """
    exporters = find_items("physic_exporters")
    return tuple(sorted(exporters, key=lambda exporter: exporter.record.name))


def missing_formats_hint(exporters: Sequence[FoundRecord[ExporterRecord]]) -> tuple[str, ...]:
    """Return a sentence about the project's formats that are not installed, or none if these
    exporters have them.
    """
    if any(exporter.distribution == FORMATS for exporter in exporters):
        return ()
    return (f"formats are in {absence_message(FORMATS)}",)


_WAYS = {
    "GLB, then Blender (docs/exports.md, FBX)": "fbx abc vrm gltf blend",
    "PLY, then CloudCompare": "las laz e57 pcd pts xyz asc",
    "STL, then the slicer": "3mf",
    "TRC, then Mokka": "c3d",
}
"""Format and program -> formats that the program makes of it, and no exporter writes."""


def find_exporter(name: str | None, suffix: str = "") -> FoundRecord[ExporterRecord]:
    """Return the exporter of a format by its name or, without a name, by a file suffix (".glb").

    Its ``record`` is an :class:`physic_core.ExporterRecord`, its ``distribution`` the plugin's
    name.

    Raises:
        ConfigError: no format has this name or suffix, or several have; the message names the
            distribution with the project's formats if it is missing.
        PackageMissingError: a package that the format needs is not installed.
    """
    exporters = find_exporters()
    wanted = (name or suffix.removeprefix(".")).lower()
    matches = [
        e
        for e in exporters
        if (e.record.name == wanted if name else suffix.lower() in e.record.suffixes)
    ]
    if len(matches) == 1:
        kind = matches[0].record
        if kind.missing_packages:
            install = (
                f": {how_to_install(matches[0].distribution, kind.extra)}" if kind.extra else ""
            )
            raise PackageMissingError(
                f"export to {kind.name} needs {', '.join(kind.missing_packages)}, which is not "
                f"installed{install}"
            )
        return matches[0]
    if matches:
        offers = " or ".join(f"{each.record.name} of {each.distribution}" for each in matches)
        same_name = len({each.record.name for each in matches}) == 1
        choose = (
            "uninstall one of them" if same_name else "state which (--to, or format= in Python)"
        )
        raise ConfigError(f"the format can be {offers}: {choose}")
    names = ", ".join(each.record.name for each in exporters)
    choices = (f"choose one of {names}",) if names else ()
    choose = "; ".join((*choices, *missing_formats_hint(exporters)))
    what = (
        f"'{name or suffix}' is not an export format"
        if name or suffix
        else "the path has no suffix"
    )
    options = [
        f"--to {each.record.name} --{option.replace('_', '-')} {wanted}"
        for each in exporters
        for option, values in each.record.options.items()
        if wanted in values
    ]
    hint = f"; '{wanted}' is an option: {' or '.join(options)}" if options else ""
    parts = wanted.replace(".", "").split(",")
    if {each.record.name for each in exporters}.issuperset(parts):
        hint = f"; write --to {parts[0]}" + ", and one command for each" * (len(parts) > 1)
    for alternative, formats in _WAYS.items():
        if wanted in formats.split():
            hint = f"; for {wanted}, write {alternative}"
    raise ConfigError(
        f"{what}: {choose} (--to, or format= in Python; physic export --list says what each is "
        f"for){hint}"
    )
