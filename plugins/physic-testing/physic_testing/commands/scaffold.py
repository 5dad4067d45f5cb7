"""The command ``physic plugins new``: write the files of a new plugin."""

from __future__ import annotations

from pathlib import Path

import click

from physic_core.cli.arguments import require_interface
from physic_core.cli.output import echo


@click.command()
@click.argument("name")
@click.option("--interface", required=True, metavar="NAME", help="Interface, such as metric_depth.")
@click.option("--folder", type=click.Path(path_type=Path), help="Output folder.  [default: physic-NAME]")
@click.option(
    "--add-to",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    metavar="FOLDER",
    help="Add the backend to the plugin in this folder, in place of a new one.",
)
def new(name: str, interface: str, folder: Path | None, add_to: Path | None) -> None:
    """Create a plugin, physic-NAME, with one backend called NAME that passes the conformance kit.

    Then replace the example code by your own.
    """
    from physic_core.discovery.plugins import core_version, discover
    from physic_core.interfaces import INTERFACES
    from physic_testing.scaffold.package import PluginNames, add_backend, write_plugin

    require_interface(interface)
    if folder is not None and add_to is not None:
        raise click.UsageError("--folder is for a new plugin, --add-to for one that exists: give one of them")
    backend = name.removeprefix("physic-")
    taken = [offer for offer in discover() if (offer.record.interface, offer.record.name) == (interface, backend)]
    if taken:
        raise click.UsageError(f"{taken[0]} is installed already: choose another name")
    names = PluginNames(backend, interface)
    api = INTERFACES[interface].api
    target = add_to or folder or Path(names.distribution)
    if add_to is not None:
        written = add_backend(add_to, names, api)
    else:
        written = write_plugin(target, names, core_version(), api)
    for file in written:
        echo(f"wrote {file}")
    echo(f"next: pip install -e {target} && physic plugins check {names.backend}")
