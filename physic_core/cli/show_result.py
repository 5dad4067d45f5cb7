"""The command ``physic show``: print what a saved result has found."""

from __future__ import annotations

from pathlib import Path

import click

from physic_core.cli.output import echo, echo_json

__all__ = ["print_summary", "show"]


@click.command()
@click.argument("out", type=click.Path(path_type=Path))
@click.option("-v", "--verbose", is_flag=True, help="Also the time of each stage, and each check that is not ok.")
@click.option("--json", "as_json", is_flag=True, help="Print one object as JSON.")
def show(out: Path, verbose: bool, as_json: bool) -> None:
    """Print the people, grade and warnings of the result in folder OUT, as `physic run` does at its end."""
    print_summary(out, verbose=verbose, as_json=as_json)


def print_summary(folder: Path, *, verbose: bool = False, as_json: bool = False) -> None:
    """Print the summary of a result.

    Raises:
        InputError: its ``reconstruction.json`` is missing, damaged, edited, or of another schema version.
    """
    import shutil
    import sys

    from physic_core.cli.result_summary import summary_record, summary_text
    from physic_core.io.results import read_document

    document = read_document(folder)
    if as_json:
        echo_json(summary_record(document, folder))
        return
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    echo(summary_text(document, folder, width=width, verbose=verbose))
