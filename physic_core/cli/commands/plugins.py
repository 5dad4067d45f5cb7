"""The command ``physic plugins``: list the installed backends, and describe one of them."""

from __future__ import annotations

import click

from physic_core.cli.arguments import require_interface, with_current_folder
from physic_core.cli.groups import ExtensibleGroup
from physic_core.cli.output import echo


@click.group(cls=ExtensibleGroup, path="plugins", invoke_without_command=True)
@click.option("--interface", metavar="NAME", help="Only backends of this interface.")
@click.pass_context
def plugins(ctx: click.Context, interface: str | None) -> None:
    """List installed backends without importing them; show or test them; create a plugin."""
    if ctx.invoked_subcommand is None:
        from physic_core.cli.listing import plugins_table

        require_interface(interface)
        echo(plugins_table(interface))


@plugins.command("show")
@click.argument("name")
@click.option("--interface", metavar="NAME", help="Only the backend of this interface.")
def show_plugin(name: str, interface: str | None) -> None:
    """Show the options, license and source of the backends called NAME."""
    from physic_core.cli.listing import describe_backend
    from physic_core.discovery.backends import find_backend, find_by_name

    require_interface(interface)
    name = with_current_folder(name)
    offers = find_by_name(name) if interface is None else (find_backend(interface, name),)
    echo("\n\n".join(describe_backend(offer) for offer in offers))
