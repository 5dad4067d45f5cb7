"""``physic plugins``: what is installed, and what each backend is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from physic_core.cli.arguments import class_here, require_interface
from physic_core.cli.doctor import doctor
from physic_core.cli.groups import ExtensibleGroup
from physic_core.cli.listing import as_dicts, detail, listing
from physic_core.cli.scaffold import new

if TYPE_CHECKING:
    from physic_core.discovery.registry import Registry

__all__ = ["plugins"]


class _Plugins(ExtensibleGroup):
    prefix = "plugins"


@click.group(cls=_Plugins, invoke_without_command=True)
@click.option("--interface", metavar="NAME", help="Only backends of this interface.")
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON.")
@click.pass_context
def plugins(ctx: click.Context, interface: str | None, as_json: bool) -> None:
    """List installed backends; show, diagnose or begin one."""
    if ctx.invoked_subcommand is None:
        import json

        from physic_core.discovery.plugins import discover

        require_interface(interface)
        found = discover()
        click.echo(json.dumps(as_dicts(found, interface), indent=2) if as_json else listing(found, interface))


@plugins.command()
@click.argument("name")
def show(name: str) -> None:
    """Say what the backends called NAME are: options, licence, source."""
    from physic_core.discovery.plugins import discover

    click.echo(details(discover(), class_here(name)))


def details(registry: Registry, name: str) -> str:
    """The text of ``physic plugins show NAME``.

    Raises:
        BackendNotFoundError: no backend is called so.
    """
    return "\n\n".join(detail(registry, claim) for claim in registry.called(name))


plugins.add_command(doctor)
plugins.add_command(new)
