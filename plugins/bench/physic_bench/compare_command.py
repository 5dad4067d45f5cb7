"""The command ``physic compare`` of two results or folders of results."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from physic_core.cli.arguments import AnyPath, ResultPath
from physic_core.cli.output import echo, echo_json, format_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_bench.comparison import Comparison
    from physic_core.errors import PhysicError


def _print_comparison(photos: Sequence[Comparison], about: Sequence[tuple[str, list[str]]]) -> None:
    """Print what was compared, a table of photos and people, and the summary of all photos."""
    from physic_bench.comparison import HEAD, table_rows

    for title, lines in about[:-1]:
        echo(f"{title}: {'; '.join(lines)}")
    rows = [row for photo in photos for row in table_rows(photo)]
    echo(format_table([HEAD, *rows]))
    echo("\n".join(about[-1][1]))


@click.command()
@click.argument("a", metavar="A", type=ResultPath())
@click.argument("b", metavar="B", type=ResultPath())
@click.option("--json", "as_json", is_flag=True, help="Print one object as JSON.")
@click.option(
    "--html", "page", type=AnyPath(), metavar="FILE", help="Also write a page with the pictures."
)
def compare(a: Path, b: Path, as_json: bool, page: Path | None) -> None:
    """Compare the results in folders A and B, or all results of the same photos in them.

    Masks match the people of A and B. "joints" is the mean distance of the joints from pelvis to
    wrists, and names the joint that differs most; "pose" is the same with aligned pelvises.
    """
    from physic_batch.contact_sheet import result_link, thumbnail_jpeg
    from physic_bench.comparison import (
        PICTURE_HEIGHT,
        changed_lines,
        compare_results,
        comparison_page,
        pair_results,
        summary_lines,
    )
    from physic_core import load_reconstruction
    from physic_core.errors import InputError
    from physic_core.files import check_own, split, write_own

    if page is not None:
        check_own(page)
    both, only = pair_results(a, b)
    photos = []
    pictures = []
    links = []
    failures = []
    for pair in both:
        try:
            results = [load_reconstruction(folder) for folder in pair]
            photos.append(compare_results(results[0], results[1], pair[0].resolve().name))
        except InputError as error:
            failures.append(error)
        else:
            if page is not None:
                pictures.append(
                    [thumbnail_jpeg(one, PICTURE_HEIGHT, numbered=True) for one in results]
                )
                links.append([result_link(page.parent, folder) for folder in pair])
    _report_failures(failures, nothing_follows=not photos)
    about = [
        ("A", [str(a)]),
        ("B", [str(b)]),
        ("changed", changed_lines(photos)),
        ("all photos", summary_lines(photos, only)),
    ]
    if as_json:
        alone = {
            f"only_{name}": list(map(str, folders))
            for name, folders in zip("ab", only, strict=True)
        }
        echo_json({"a": str(a), "b": str(b), "photos": split(photos, {}), **alone})
    else:
        _print_comparison(photos, about)
    if page is not None:
        html = comparison_page(photos, pictures, links, about)
        echo(f"wrote {write_own(page, html.encode())}", err=as_json)
    if failures:
        raise failures[-1]


def _report_failures(failures: Sequence[PhysicError], *, nothing_follows: bool) -> None:
    """Print all failures but the last one, and raise that if nothing else follows."""
    for failure in failures[:-1]:
        echo(f"Error: {failure}", err=True)
    if failures and nothing_follows:
        raise failures[-1]
