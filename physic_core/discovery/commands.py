"""Find the commands that installed plugins add to ``physic``."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from contextlib import redirect_stdout, suppress
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING, NamedTuple

from physic_core.discovery.records import CommandRecord
from physic_core.discovery.registration import load_plugin, records_of, selected

if TYPE_CHECKING:
    from physic_core.discovery.claims import Origin

__all__ = ["InstalledCommand", "find_commands"]


class InstalledCommand(NamedTuple):
    """A command that a plugin adds.

    Attributes:
        record: the command.
        entry: the entry point of the plugin.
    """

    record: CommandRecord
    entry: EntryPoint

    @property
    def origin(self) -> Origin:
        """The plugin."""
        from physic_core.discovery.entry_points import origin_of

        return origin_of(self.entry)


def find_commands(
    installed: Iterable[EntryPoint] | None = None, *, environment: Mapping[str, str] = os.environ
) -> tuple[InstalledCommand, ...]:
    """Call the hook ``physic_commands`` of every installed plugin; broken plugins are left out.

    No backend is checked and no metadata read, so that ``physic --help`` is fast.

    Args:
        installed: entry points; None for those of this Python.
        environment: may restrict the plugins with ``PHYSIC_PLUGINS``.
    """
    commands: list[InstalledCommand] = []
    for entry in sorted(selected(installed, environment)[0], key=lambda e: e.value):
        with suppress(Exception, SystemExit), redirect_stdout(sys.stderr):
            commands += [
                InstalledCommand(r, entry) for r in records_of(load_plugin(entry), "physic_commands", CommandRecord)
            ]
    return tuple(commands)
