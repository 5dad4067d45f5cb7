"""The command ``physic weights``: list, download and verify what the networks of installed plugins
need.
"""

from __future__ import annotations

from collections import Counter
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from physic_core.cli.arguments import FolderPath
from physic_core.cli.exit_codes import INTERRUPTED, WEIGHTS
from physic_core.cli.output import echo, format_table
from physic_core.errors import PhysicError
from physic_core.weights import (
    common_folder,
    describe_mismatch,
    format_size,
    locate_files,
    presence,
    read_library,
)

if TYPE_CHECKING:
    from physic_core.weights import WeightFile

_USE = {True: "yes", False: "NO", None: "not stated"}


@click.group()
def weights() -> None:
    """List, download and verify the weights that plugins need.

    PhySIC searches the folders in PHYSIC_WEIGHTS, your cache folder and the cache of Hugging Face.
    Only `fetch` uses the network.
    """


@weights.command("list")
@click.option(
    "--missing", is_flag=True, help="Only sets that are missing, incomplete or of unexpected size."
)
def list_weights(missing: bool) -> None:
    """List all weight sets: plugin, size, license, installed or not."""

    library = read_library()
    sets = [
        listed for listed in library.sets if not (missing and presence(listed.weights) == "here")
    ]
    rows = [("weights", "plugin", "size", "commercial use", "account", "state", "license")]
    for listed in sets:
        weight_set = listed.weights
        account = "needed" if weight_set.needs_account else "-"
        rows.append(
            (
                *(
                    weight_set.name,
                    listed.offer.distribution,
                    format_size(weight_set.bytes) or "-",
                    _USE[weight_set.commercial],
                    account,
                ),
                *(presence(listed.weights), weight_set.license),
            )
        )
    for offer, why in library.broken:
        rows.append(("-", offer.distribution, "-", "-", "-", "BROKEN", " ".join(why.split())))
    nothing = "nothing is missing" if missing else "no plugin lists weights"
    echo(format_table(rows) if len(rows) > 1 else nothing)


@weights.command()
@click.argument("names", nargs=-1, metavar="[NAME...]")
@click.pass_context
def verify(ctx: click.Context, names: tuple[str, ...]) -> None:
    """Compare files with their published sizes and SHA-256.

    Without NAME, it compares all weight sets. Exits with code 4 if a file differs, or if a
    file of a set NAME is missing.
    """

    library = read_library()
    count = Counter[str]()
    for listed in [library.get(name) for name in dict.fromkeys(names)] or library.sets:
        local_files = locate_files(listed.weights)
        for file in listed.weights.files:
            path = local_files.get(file.path)
            wrong = "" if path is None else describe_mismatch(path, file)
            note = wrong or ("" if file.sha256 or path is None else "no SHA-256 is published")
            state = "DIFFERS" if wrong else "ok"
            if path is None:
                state = "missing"
            if path is not None or names:
                count[state] += 1
                echo(
                    f"{state:<8} {listed.weights.name} "
                    f"{path or file.path}{f': {note}' if note else ''}"
                )
    files = "1 file" if count.total() == 1 else f"{count.total()} files"
    echo(f"{files}: {count['ok']} ok, {count['DIFFERS']} differ, {count['missing']} missing")
    ctx.exit(WEIGHTS if count["DIFFERS"] or count["missing"] else 0)


@weights.command()
@click.argument("names", nargs=-1, required=True, metavar="NAME...")
@click.option(
    "--accept-license",
    "accept",
    is_flag=True,
    help="Accept a license that restricts use or requires an account.",
)
@click.option(
    "--to",
    type=FolderPath(),
    metavar="FOLDER",
    help="Download to this folder, to copy it to a machine without network. Set PHYSIC_WEIGHTS to "
    "it there.",
)
@click.pass_context
def fetch(ctx: click.Context, names: tuple[str, ...], accept: bool, to: Path | None) -> None:
    """Download missing files of the weight sets NAME, and verify them.

    Repeat the command to resume. Exits with code 4 if a file is still missing.
    """
    from physic_setup.fetch import fetch as fetch_set

    library = read_library()
    chosen = [library.get(name) for name in dict.fromkeys(names)]
    failed = False
    for listed in chosen:
        name = listed.weights.name
        try:
            fetched = fetch_set(
                listed.weights, accept=accept, to=to, report=partial(_print_download, name)
            )
        except PhysicError as error:
            failed = True
            echo(f"{name}: {error}", err=True)
        except KeyboardInterrupt:
            echo(f"{name}: interrupted; complete files are kept", err=True)
            ctx.exit(INTERRUPTED)
        else:
            local_files = locate_files(listed.weights)
            folder_text = (
                to / name
                if to
                else common_folder(local_files) or ", ".join(map(str, local_files.values()))
            )
            echo(
                f"{name}: {', '.join(fetched)} downloaded to {folder_text}"
                if fetched
                else f"{name}: already in {folder_text}"
            )
    ctx.exit(WEIGHTS if failed else 0)


def _print_download(name: str, file: WeightFile) -> None:
    echo(f"{name}: {file.path} ({format_size(file.bytes) or '-'})", err=True)
