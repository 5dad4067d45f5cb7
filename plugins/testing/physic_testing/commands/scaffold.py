"""The command ``physic plugins new``: write the files of a new plugin."""

from __future__ import annotations

from pathlib import Path

import click

from physic_core.cli.arguments import AnyPath, require_interface
from physic_core.cli.output import echo


@click.command()
@click.argument("name")
@click.option("--interface", required=True, metavar="NAME", help="Interface, such as metric_depth.")
@click.option("--folder", type=AnyPath(), help="Output folder.  [default: physic-NAME]")
def new(name: str, interface: str, folder: Path | None) -> None:
    """Create a plugin, physic-NAME, with one backend that passes the conformance tests.

    Then replace the example code by your own.
    """
    from physic_core.discovery.backends import list_backends
    from physic_core.discovery.entry_points import core_version
    from physic_testing.scaffold.package import PluginNames, write_plugin

    require_interface(interface)
    names = PluginNames(name.removeprefix("physic-"), interface)
    if taken := [offer for offer in list_backends(interface) if offer.name == names.backend]:
        raise click.UsageError(f"{taken[0]} is installed already: choose another name")
    target = folder or Path(names.distribution)
    for file in write_plugin(target, names, core_version()):
        echo(f"wrote {file}")
    echo(f"next: pip install -e {target} && physic plugins check {names.backend}")
