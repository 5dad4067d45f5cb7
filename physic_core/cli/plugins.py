"""The command ``physic plugins``: list the installed backends, and describe one of them."""

from __future__ import annotations

import click

from physic_core.cli.arguments import require_interface, with_current_folder
from physic_core.cli.groups import ExtensibleGroup
from physic_core.cli.output import echo, echo_json

_INTERFACE = click.option("--interface", metavar="NAME", help="Only backends of this interface.")
_JSON = click.option("--json", "as_json", is_flag=True, help="Print as JSON.")


@click.group(cls=ExtensibleGroup, path="plugins", invoke_without_command=True)
@_INTERFACE
@_JSON
@click.pass_context
def plugins(ctx: click.Context, interface: str | None, as_json: bool) -> None:
    """List installed backends without importing them; show or test them; create a plugin."""
    if ctx.invoked_subcommand is None:
        _list(interface, as_json)


@plugins.command("list")
@_INTERFACE
@_JSON
def list_plugins(interface: str | None, as_json: bool) -> None:
    """List installed backends, as `physic plugins` does."""
    _list(interface, as_json)


def _list(interface: str | None, as_json: bool) -> None:
    from physic_core.cli.listing import plugins_as_dicts, plugins_table

    require_interface(interface)
    if as_json:
        echo_json(plugins_as_dicts(interface))
    else:
        echo(plugins_table(interface))


@plugins.command("show")
@click.argument("name")
def show_plugin(name: str) -> None:
    """Show the options, licence and source of the backends called NAME."""
    from physic_core.cli.listing import describe_backend
    from physic_core.discovery.backends import find_by_name

    echo("\n\n".join(describe_backend(offer) for offer in find_by_name(with_current_folder(name))))
