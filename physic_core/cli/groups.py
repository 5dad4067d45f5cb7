"""Groups of commands that installed plugins can add to."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from physic_core.errors import PhysicError

if TYPE_CHECKING:
    from physic_core.discovery.records import InstalledCommand

__all__ = ["ExtensibleGroup"]


class ExtensibleGroup(click.Group):
    """A group whose commands are its own and those that plugins add by the hook ``physic_commands``.

    Plugins are looked for only when help is printed or when a command is not one of the group's own. A plugin's
    command is imported when it is run. The group's own commands win over a plugin's command of the same name.
    """

    prefix: str = ""
    """How the group itself is called after ``physic``; empty for ``physic``."""

    def _added(self) -> dict[str, InstalledCommand]:
        from physic_core.discovery.entry_points import find

        added: dict[str, InstalledCommand] = {}
        for command in find().commands:
            group, _, name = command.record.name.rpartition(" ")
            if group == self.prefix and name not in self.commands:
                added.setdefault(name, command)
        return added

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of all commands, the plugins' ones included."""
        return sorted({*super().list_commands(ctx), *self._added()})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The group's own command, or a plugin's, imported now."""
        own = super().get_command(ctx, cmd_name)
        if own is not None:
            return own
        added = self._added().get(cmd_name)
        return _load(added) if added is not None else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands without importing those of plugins."""
        added = self._added()
        names = sorted({*self.commands, *added})
        limit = formatter.width - 6 - max(map(len, names), default=0)
        rows = []
        for name in names:
            own = self.commands.get(name)
            if own is None:
                rows.append((name, added[name].record.summary))
            elif not own.hidden:
                rows.append((name, own.get_short_help_str(limit)))
        if rows:
            with formatter.section("Commands"):
                formatter.write_dl(rows)


def _load(command: InstalledCommand) -> click.Command:
    """Import a plugin's command.

    Raises:
        PhysicError: it cannot be imported, or is no ``click.Command``.
    """
    from importlib import import_module

    from physic_core.discovery.error_text import describe

    record = command.record
    module, _, attribute = record.target.partition(":")
    try:
        found = getattr(import_module(module), attribute)
    except Exception as error:
        raise PhysicError(
            f"the command '{record.name}' of {command.origin} cannot be imported: {describe(error, module)}"
        ) from error
    if not isinstance(found, click.Command):
        raise PhysicError(
            f"the command '{record.name}' of {command.origin} should be a click.Command, "
            f"and {record.target} is {type(found).__name__}"
        )
    return found
