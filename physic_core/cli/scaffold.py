"""``physic plugins new``: create the files of a new plugin."""

from __future__ import annotations

from pathlib import Path

import click

from physic_core.cli.arguments import require_interface

__all__ = ["new"]


@click.command()
@click.argument("name")
@click.option("--interface", required=True, metavar="NAME", help="Interface, such as metric_depth.")
@click.option("--folder", type=click.Path(path_type=Path), help="Output folder.  [default: physic-NAME]")
def new(name: str, interface: str, folder: Path | None) -> None:
    """Create a plugin, physic-NAME, with one backend called NAME that passes the conformance kit.

    Then replace the placeholder by your own code.
    """
    from physic_core.discovery.plugins import core_version, discover
    from physic_core.interfaces import INTERFACES
    from physic_core.scaffold.package import Names, write

    require_interface(interface)
    backend = name.removeprefix("physic-")
    taken = [claim for claim in discover() if (claim.record.interface, claim.record.name) == (interface, backend)]
    if taken:
        raise click.UsageError(f"{taken[0]} is installed already: choose another name")
    names = Names(backend, interface)
    target = folder or Path(names.distribution)
    for file in write(target, names, core_version(), INTERFACES[interface].api):
        click.echo(f"wrote {file}")
    click.echo(f"next: pip install -e {target} && physic plugins check {names.backend}")
