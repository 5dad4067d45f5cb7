"""The command ``physic compare``: what differs between two results, or two folders of results."""

from __future__ import annotations

from pathlib import Path

import click

from physic_core.cli.output import echo, echo_json, format_table


@click.command()
@click.argument("a", metavar="A", type=click.Path(path_type=Path))
@click.argument("b", metavar="B", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print one object as JSON.")
@click.option(
    "--html", "page", type=click.Path(path_type=Path), metavar="FILE", help="Also write a page with the pictures."
)
def compare(a: Path, b: Path, as_json: bool, page: Path | None) -> None:
    """Compare the results in folders A and B, or all results of the same photos in them.

    People are matched by their masks. Joints is the mean distance of the joints from pelvis to wrists; pose is the same
    with both pelvises in one place.
    """
    from physic_core.batch.comparison import compare_results, pair_results
    from physic_core.batch.comparison_page import HEAD, comparison_page, picture_pair, summary_lines, table_rows
    from physic_core.errors import InputError
    from physic_core.files.own import check_own, write_own
    from physic_core.files.plain import split
    from physic_core.io.results import load_reconstruction

    if page is not None:
        check_own(page)
    paired = pair_results(a, b)
    photos, pictures, failed = [], [], None
    for pair in paired.both:
        try:
            results = [load_reconstruction(folder) for folder in pair]
            photos.append(compare_results(pair[0].resolve().name, results[0], results[1]))
        except InputError as error:
            if failed is not None:
                echo(f"Error: {failed}", err=True)
            failed = error
        else:
            if page is not None:
                pictures.append(picture_pair(results[0], results[1]))
    lines = summary_lines(photos, paired.only)
    if as_json:
        only = {f"only_{name}": list(map(str, folders)) for name, folders in zip("ab", paired.only, strict=True)}
        echo_json({"a": str(a), "b": str(b), "photos": split(photos, {}), **only})
    else:
        echo(f"A: {a}\nB: {b}")
        rows = [row for photo in photos for row in table_rows(photo)]
        echo(format_table([HEAD, *rows]))
        echo("\n".join(lines))
    if page is not None:
        echo(
            f"wrote {write_own(page, comparison_page(photos, pictures, (str(a), str(b)), lines).encode())}", err=as_json
        )
    if failed is not None:
        raise failed
