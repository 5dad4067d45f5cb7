"""Find the commands that installed plugins add to ``physic``."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from contextlib import redirect_stdout, suppress
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING, NamedTuple

from physic_core.discovery.plugin_code import plugin_code
from physic_core.discovery.records import CommandRecord
from physic_core.discovery.registration import call_hook, load_plugin, select_entry_points

if TYPE_CHECKING:
    from physic_core.discovery.offers import Origin

__all__ = ["InstalledCommand", "find_commands"]


class InstalledCommand(NamedTuple):
    """The record of a command, and the entry point of the plugin that adds it."""

    record: CommandRecord
    entry: EntryPoint

    @property
    def origin(self) -> Origin:
        """The plugin that adds the command."""
        from physic_core.discovery.entry_points import origin_of

        return origin_of(self.entry)


def find_commands(
    installed: Iterable[EntryPoint] | None = None, *, environment: Mapping[str, str] = os.environ
) -> tuple[InstalledCommand, ...]:
    """Call the hook ``physic_commands`` of every installed plugin, and return the commands; skip broken plugins.

    No backend is checked and no metadata is read, so that ``physic --help`` is fast.

    Args:
        installed: entry points; None for those of this Python.
        environment: may restrict the plugins with ``PHYSIC_PLUGINS``.
    """
    commands: list[InstalledCommand] = []
    for entry in sorted(select_entry_points(installed, environment)[0], key=lambda e: e.value):
        with suppress(Exception), plugin_code(), redirect_stdout(sys.stderr):
            commands += [
                InstalledCommand(r, entry) for r in call_hook(load_plugin(entry), "physic_commands", CommandRecord)
            ]
    return tuple(commands)
