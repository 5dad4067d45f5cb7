"""The command ``physic report``: the page of a result, or of a folder of results."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from physic_core.cli.arguments import AnyPath, ResultPath
from physic_core.cli.output import echo

if TYPE_CHECKING:
    from physic_core.errors import PhysicError


@click.command()
@click.argument("results", metavar="OUT...", nargs=-1, required=True, type=ResultPath())
@click.option("-o", "--out", type=AnyPath(), help="Write the page of one result to this file.")
@click.option(
    "--title", metavar="TEXT", default="", help="Title of the page.  [default: name of the photo]"
)
@click.option(
    "--each", is_flag=True, help="In a folder of results, also write a page for each one."
)
def report(results: tuple[Path, ...], out: Path | None, title: str, each: bool) -> None:
    """Write report.html of each result OUT: scene, people, contact and numbers in one file for a
    browser.

    In a folder of results, such as that of a batch, it writes contact-sheet.html, which links to
    their pages.
    """
    if (out is not None or title) and len(results) > 1:
        raise click.UsageError(
            f"{'--out' if out is not None else '--title'} needs one result, got {len(results)}"
        )
    from physic_core.errors import InputError, OutputError
    from physic_core.io.result_folder import is_result
    from physic_core.pictures import require_pictures

    if out is not None or each or any(map(is_result, results)):
        require_pictures()
    first: PhysicError | None = None
    for folder in results:
        try:
            _write_report(folder, out, title, each)
        except (InputError, OutputError) as error:
            if first is not None:
                echo(f"Error: {first}", err=True)
            first = error
    if first is not None:
        raise first


def _write_report(folder: Path, out: Path | None, title: str, each: bool) -> None:
    from physic_core.io.report_file import add_report, save_report
    from physic_core.io.result_folder import ARRAYS_FILE, is_result

    if out is not None:
        from physic_core.io.results import load_reconstruction

        result = load_reconstruction(folder)
        echo(
            f"wrote {save_report(result, out, title or result.photo_name or folder.resolve().name)}"
        )
    # arrays alone are not a folder of results
    elif is_result(folder) or (folder / ARRAYS_FILE).is_file():
        echo(f"wrote {add_report(folder, title)}")
    else:
        _write_index(folder, each)


def _write_index(folder: Path, each: bool) -> None:
    """Write the contact sheet of a folder of results, and with ``each`` the page of every
    result.
    """
    from physic_batch.contact_sheet import (
        check_contact_sheet,
        find_results,
        write_contact_sheet,
    )
    from physic_core.errors import InputError
    from physic_core.io.report_file import add_report

    results = find_results(folder)
    check_contact_sheet(folder)
    for number, result in enumerate(results if each else (), 1):
        try:
            path = add_report(result)
        # the page states the error, and the other results get their pages
        except InputError as error:
            echo(f"[{number}/{len(results)}] {error}", err=True)
        else:
            echo(f"[{number}/{len(results)}] {path}", err=True)
    echo(f"wrote {write_contact_sheet(folder, results)}")
