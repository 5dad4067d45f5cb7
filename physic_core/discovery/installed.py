"""Find what installed plugins add: commands and exporters by hooks, the rest by entry points of a group of its own."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from importlib import import_module
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from physic_core.discovery.plugin_code import named_plugin_code
from physic_core.discovery.records import RECORD_HOOKS, CommandRecord, ExporterRecord, TargetRecord
from physic_core.discovery.registration import PLUGINS_GROUP, call_hook, register_plugins, select_entry_points
from physic_core.errors import ConfigError, PackageMissingError, PluginError

if TYPE_CHECKING:
    from physic_core.discovery.offers import Origin

_Record = TypeVar("_Record", bound=CommandRecord | ExporterRecord | TargetRecord)


class Installed(NamedTuple, Generic[_Record]):
    """A record, and the entry point that it is or comes from."""

    record: _Record
    entry: EntryPoint

    @property
    def origin(self) -> Origin:
        """The plugin; this reads the metadata of its distribution."""
        from physic_core.discovery.entry_points import origin_of

        return origin_of(self.entry)


def find_installed(
    kind: type[_Record], installed: Iterable[EntryPoint] | None = None, *, environment: Mapping[str, str] = os.environ
) -> tuple[Installed[_Record], ...]:
    """Call the hook for one kind of record of every installed plugin; broken plugins are skipped.

    No backend is checked and no metadata is read, so that ``physic --help`` is fast.

    Args:
        kind: class of the records, of :data:`RECORD_HOOKS`.
        installed: entry points; None for those of this Python.
        environment: may restrict the plugins with ``PHYSIC_PLUGINS``.
    """
    plugins = register_plugins(select_entry_points(PLUGINS_GROUP, installed, environment)[0])
    answers = {answer.plugin: answer.returned or () for answer in call_hook(plugins, RECORD_HOOKS[kind])}
    return tuple(
        Installed(record, entry) for name, entry in plugins.entries.items() for record in answers.get(name, ())
    )


def find_entries(group: str) -> tuple[Installed[TargetRecord], ...]:
    """Return the entry points of a group without hooks, sorted by value; none is imported."""
    found = sorted(select_entry_points(group, None, os.environ)[0], key=lambda entry: entry.value)
    return tuple(Installed(TargetRecord(entry.name, entry.value), entry) for entry in found)


def find_entry(group: str, name: str, role: str, *, own: str, known: Mapping[str, str]) -> Installed[TargetRecord]:
    """Return the entry point of a name.

    Args:
        group: without hooks.
        name: of the entry point.
        role: what it is, for the messages, such as "executor".
        own: name that the core itself offers, which the messages list, too.
        known: distribution of each known name.

    Raises:
        ConfigError: no plugin, or more than one, offers the name.
    """
    from physic_core.discovery.close_names import did_you_mean

    installed = find_entries(group)
    found = [one for one in installed if one.record.name == name]
    if len(found) == 1:
        return found[0]
    if found:
        owners = " and ".join(sorted(one.origin.distribution for one in found))
        raise ConfigError(f"the {role} '{name}' is offered by {owners}: uninstall one of them")
    if name in known:
        raise ConfigError(f"the {role} '{name}' needs {explain_absence(known[name])}")
    names = sorted({own, *known, *(one.record.name for one in installed)})
    raise ConfigError(f"no {role} named '{name}'; there are: {', '.join(names)}{did_you_mean(name, names)}")


def find_only_entry(group: str, what: str, distribution: str) -> Installed[TargetRecord]:
    """Return the one entry point of a group.

    Args:
        group: without hooks.
        what: start of the messages, such as "report.html is made by".
        distribution: that usually has it.

    Raises:
        PackageMissingError: no plugin has one.
        ConfigError: several have.
    """
    found = find_entries(group)
    if not found:
        raise PackageMissingError(f"{what} {explain_absence(distribution)}")
    if len(found) > 1:
        names = " and ".join(one.origin.distribution for one in found)
        raise ConfigError(f"{what} {names}: uninstall one of them")
    return found[0]


def import_target(found: Installed[Any], role: str) -> Any:
    """Import what the target of a record names.

    Args:
        found: the record.
        role: what the record is, for the message: "command", "energy", "executor", "exporter" or "page".

    Raises:
        PluginError: it cannot be imported.
    """
    module, _, attribute = found.record.target.partition(":")
    with named_plugin_code(f"{_title(found, role)} cannot be imported", module, kind=PluginError):
        return getattr(import_module(module), attribute)


def call_target(found: Installed[Any], role: str, *arguments: object) -> Any:
    """Import the function that the target of a record names, and call it.

    Args:
        found: the record.
        role: as of :func:`import_target`.
        arguments: of the function.

    Raises:
        PluginError: it cannot be imported, or fails.
        PhysicError: raised by the function itself.
    """
    function = import_target(found, role)
    with named_plugin_code(f"{_title(found, role)} fails", found.record.target.partition(":")[0], kind=PluginError):
        return function(*arguments)


def explain_absence(distribution: str) -> str:
    """Return the reason why nothing of a known distribution is found, and how to install it.

    As "physic-ray, which is not installed: `pip install ...`".
    """
    from physic_core.discovery.catalog import how_to_install
    from physic_core.discovery.entry_points import find_plugins

    found, reason = find_plugins(), "not installed"
    if found.restriction is not None:
        reason = f"not installed, or hidden by PHYSIC_PLUGINS='{found.restriction}'"
    broken = [plugin.cause for plugin in found.broken if plugin.origin.distribution == distribution]
    if broken:
        reason = f"broken ({broken[0]})"
    return f"{distribution}, which is {reason}: {how_to_install(distribution)}"


def _title(found: Installed[Any], role: str) -> str:
    return f"the {role} '{found.record.name}' of {found.origin}"
