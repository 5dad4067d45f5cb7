"""A command group that imports a command only when it runs, and that plugins can extend."""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from physic_core.discovery.hooks import PluginItem
    from physic_core.discovery.plugins import FoundRecord


_CURES = {
    "--gpu": "choose a device: --device cuda",
    "--cpu": "choose a device: --device cpu",
    "--fov": "give the focal length: --focal-px",
    "--height": "a person's height is --stature, the camera's --camera-height",
    "--seed": "the same photo has the same result without one",
    "--share": "docs/serve.md says who can reach a server",
    "--recursive": "the search includes subfolders",
    "--jobs": "the number of processes is --workers",
    "--resume": "run the same command again: it resumes",
    "--threads": "write --set run.threads=N",
    "--export": "export afterwards: physic export FOLDER --to FORMAT",
}
"""Options of other programs -> what to do here."""

_NEAR = 0.75


def with_suggestion(error: click.UsageError) -> click.UsageError:
    """Return the error of a command line, with what to write in place of what does not exist."""
    ctx = error.ctx
    if ctx is None:
        return error
    if isinstance(error, click.NoSuchCommand):
        return click.UsageError(_no_command_message(error.command_name, ctx))
    if isinstance(error, click.NoSuchOption):
        return click.UsageError(
            f"No such option '{error.option_name}': {_advice_for_option(error, ctx)}", ctx
        )
    if error.message.startswith("Got unexpected extra argument"):
        return click.UsageError(f"{error.message}: {_accepted_arguments(ctx)}", ctx)
    return error


def _no_command_message(name: str, ctx: click.Context) -> str:
    from physic_core.discovery.catalog import COMMANDS
    from physic_core.discovery.error_text import did_you_mean
    from physic_core.discovery.plugins import absence_message

    path = ctx.command_path
    full_name = " ".join([*path.split()[1:], name])
    if (distribution := COMMANDS.get(full_name)) is not None:
        return f"'physic {full_name}' is a command of {absence_message(distribution)}"
    if ctx.parent is None and os.path.isdir(name):
        cure = f": did you mean 'physic batch {name} -o results'?"
    elif ctx.parent is None and os.path.splitext(name)[1]:
        cure = f": did you mean 'physic run {name}'?"
    elif name in ("help", "version"):
        cure = f": write {path} --{name}"
    else:
        commands = ctx.command.list_commands(ctx) if isinstance(ctx.command, click.Group) else []
        cure = did_you_mean(name, commands) or f"; there are: {', '.join(commands)}"
    return f"No such command '{name}'{cure}"


def _advice_for_option(error: click.NoSuchOption, ctx: click.Context) -> str:
    """Return what to do in place of an option that does not exist; only near ones are suggested."""
    name = error.option_name
    near = difflib.get_close_matches(name, error.possibilities or (), cutoff=_NEAR)
    if name in _CURES:
        return _CURES[name]
    if near:
        return f"did you mean {' or '.join(near)}?"
    if isinstance(ctx.command, click.Group):
        return f"options follow the command, as in {ctx.command_path} COMMAND {name}"
    if not name.startswith("--"):
        return f"a file whose name begins so is ./{name}..."
    return f"{ctx.command_path} --help lists all"


def _accepted_arguments(ctx: click.Context) -> str:
    """Return what a command takes beside options."""
    arguments = [one for one in ctx.command.params if isinstance(one, click.Argument)]
    names = " ".join(one.make_metavar(ctx) for one in arguments) or "options alone"
    is_configured = any(one.name == "overrides" for one in ctx.command.params)
    also = ", such as --config FILE and --set KEY=VALUE" if is_configured else ""
    return f"{ctx.command_path} takes {names}{also}"


class ExtensibleGroup(click.Group):
    """A command group with the commands of the core, and the commands of plugins (hook
    ``physic_commands``).

    ``--help`` imports no command. Plugins are searched only for the help, and for a command that
    the core does not have. A command of the core overrides a plugin's command of the same name.

    Args:
        path: the words after ``physic`` that call the group; empty for ``physic`` itself.
        own: "package.module:function" and summary, by name, of each command of the core that is
            imported when it runs.
    """

    def __init__(
        self,
        *args: Any,
        path: str = "",
        own: Mapping[str, tuple[str, str]] | None = None,
        **settings: Any,
    ) -> None:
        super().__init__(*args, **settings)
        self.path = path
        self.own = dict(own or {})

    def _plugin_commands(self) -> dict[str, FoundRecord[PluginItem]]:
        from physic_core.discovery.plugins import find_items

        added: dict[str, FoundRecord[PluginItem]] = {}
        for command in find_items("physic_commands"):
            path, _, name = command.record.name.rpartition(" ")
            if path == self.path and name not in self.own and name not in self.commands:
                added.setdefault(name, command)
        return added

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands, including those of plugins."""
        return sorted({*self.own, *self.commands, *self._plugin_commands()})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a command of the core or of a plugin, or None if no command has this
        name.

        Raises:
            PluginError: the plugin is broken.
        """
        if cmd_name in self.own:
            module, _, attribute = self.own[cmd_name][0].partition(":")
            own: click.Command = getattr(import_module(module), attribute)
            return own
        if cmd_name in self.commands:
            return self.commands[cmd_name]
        command = self._plugin_commands().get(cmd_name)
        return None if command is None else _load(command)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands and their summaries."""
        summaries = {
            name: command.record.summary for name, command in self._plugin_commands().items()
        }
        summaries |= {name: summary for name, (_, summary) in self.own.items()}
        for name, command in self.commands.items():
            summaries[name] = " ".join((command.help or "").partition("\n\n")[0].split())
        with formatter.section("Commands"):
            formatter.write_dl(sorted(summaries.items()))


def _load(command: FoundRecord[PluginItem]) -> click.Command:
    """Import a plugin's command.

    Raises:
        PluginError: it cannot be imported, or is not a ``click.Command``.
    """
    from physic_core.discovery.plugins import import_item
    from physic_core.errors import PluginError

    loaded = import_item(command, "command")
    if not isinstance(loaded, click.Command):
        raise PluginError(
            f"{command.title('command')} should be a click.Command, "
            f"but {command.record.target} is a {type(loaded).__name__}"
        )
    return loaded
