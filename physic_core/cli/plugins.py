"""``physic plugins``: list the installed backends and show one of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from physic_core.cli.arguments import class_here, require_interface
from physic_core.cli.groups import ExtensibleGroup

if TYPE_CHECKING:
    from physic_core.discovery.registry import Registry

__all__ = ["details", "plugins", "show"]


_COMMANDS = {
    "doctor": ("physic_core.cli.doctor:doctor", "Load each installed backend and report what is missing or broken."),
    "new": ("physic_core.cli.scaffold:new", "Create a plugin with one backend that passes the conformance kit."),
    "show": ("physic_core.cli.plugins:show", "Show the options, licence and source of a backend."),
}


@click.group(cls=ExtensibleGroup, path="plugins", own=_COMMANDS, invoke_without_command=True)
@click.option("--interface", metavar="NAME", help="Only backends of this interface.")
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
@click.pass_context
def plugins(ctx: click.Context, interface: str | None, as_json: bool) -> None:
    """List installed backends; show, diagnose or create one."""
    if ctx.invoked_subcommand is None:
        import json

        from physic_core.cli.listing import as_dicts, listing
        from physic_core.discovery.misplaced import plugins_in_other_groups
        from physic_core.discovery.plugins import discover

        require_interface(interface)
        found = discover()
        click.echo(json.dumps(as_dicts(found, interface), indent=2) if as_json else listing(found, interface))
        if unread := plugins_in_other_groups():
            names = ", ".join(str(plugin.origin) for plugin in unread)
            click.echo(f"not read, wrong entry-point group: {names}; see `physic plugins doctor`", err=True)


@click.command()
@click.argument("name")
def show(name: str) -> None:
    """Show the options, licence and source of the backends called NAME."""
    from physic_core.discovery.plugins import discover

    click.echo(details(discover(), class_here(name)))


def details(registry: Registry, name: str) -> str:
    """Return the text of ``physic plugins show NAME``.

    Raises:
        BackendNotFoundError: no backend has this name.
    """
    from physic_core.cli.listing import detail

    return "\n\n".join(detail(registry, claim) for claim in registry.called(name))
