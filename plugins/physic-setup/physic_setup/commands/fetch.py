"""The command ``physic weights fetch``: download the weights of installed plugins."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from physic_core.cli.exit_codes import INTERRUPTED, WEIGHTS
from physic_core.cli.output import echo
from physic_core.errors import PhysicError

if TYPE_CHECKING:
    from physic_core.weights.manifest import WeightFile


@click.command()
@click.argument("names", nargs=-1, required=True, metavar="NAME...")
@click.option(
    "--accept-licence",
    "--accept-license",
    "accept",
    is_flag=True,
    help="Accept a licence that restricts use or requires an account.",
)
@click.option(
    "--to",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="FOLDER",
    help="Download to this folder, to copy it to a machine without network. Set PHYSIC_WEIGHTS to it there.",
)
@click.pass_context
def fetch(ctx: click.Context, names: tuple[str, ...], accept: bool, to: Path | None) -> None:
    """Download the missing files of the weight sets NAME..., and verify their size and SHA-256.

    The next call goes on with the files that are missing. Exits with code 4 if one still is.
    """
    from physic_core.weights.find import common_folder, locate_files
    from physic_core.weights.library import read_library
    from physic_setup.fetch import fetch as fetch_set

    library = read_library()
    chosen = [library.get(name) for name in dict.fromkeys(names)]
    failed = False
    for one in chosen:
        name = one.weights.name
        try:
            fetched = fetch_set(one.weights, accept=accept, to=to, report=partial(_report, name))
        except PhysicError as error:
            failed = True
            echo(f"{name}: {error}", err=True)
        except KeyboardInterrupt:
            echo(f"{name}: interrupted; complete files are kept", err=True)
            ctx.exit(INTERRUPTED)
        else:
            here = locate_files(one.weights)
            where = to / name if to else common_folder(here) or ", ".join(map(str, here.values()))
            echo(f"{name}: {', '.join(fetched)} downloaded to {where}" if fetched else f"{name}: already in {where}")
    ctx.exit(WEIGHTS if failed else 0)


def _report(name: str, file: WeightFile) -> None:
    from physic_core.weights.find import format_size

    echo(f"{name}: {file.path} ({format_size(file.bytes) or '-'})", err=True)
