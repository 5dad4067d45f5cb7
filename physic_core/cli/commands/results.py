"""The commands on saved results: ``physic compare`` of two results or folders of results,
``physic report`` (the page), ``physic export`` (the format of another program), and ``physic show``
(the summary).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from physic_core.cli.arguments import AnyPath, ResultPath
from physic_core.cli.output import echo, echo_json, format_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.batch.comparison import Comparison
    from physic_core.errors import PhysicError


def _print_comparison(photos: Sequence[Comparison], about: Sequence[tuple[str, list[str]]]) -> None:
    """Print what was compared, a table of photos and people, and the summary of all photos."""
    from physic_core.batch.comparison import HEAD, table_rows

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

    People are matched by their masks. Joints is the mean distance of the joints from pelvis to
    wrists, with the joint that is farthest apart; pose is the same with both pelvises in one place.
    The distance of a photo is the median depth of its scene.
    """
    from physic_core.batch.comparison import (
        PICTURE_HEIGHT,
        changed_lines,
        compare_results,
        comparison_page,
        pair_results,
        summary_lines,
    )
    from physic_core.batch.contact_sheet import result_link, thumbnail_jpeg
    from physic_core.errors import InputError
    from physic_core.files.atomic import check_own, write_own
    from physic_core.files.plain import split
    from physic_core.io.results import load_reconstruction

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
    _report_failures(failures, last=not photos)
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


def _report_failures(failures: Sequence[PhysicError], *, last: bool) -> None:
    """Print all failures but the last one, and raise that if nothing else follows."""
    for failure in failures[:-1]:
        echo(f"Error: {failure}", err=True)
    if failures and last:
        raise failures[-1]


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

    A folder of results, such as that of a batch, gets contact-sheet.html, which links to their
    pages.
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
            _write(folder, out, title, each)
        except (InputError, OutputError) as error:
            if first is not None:
                echo(f"Error: {first}", err=True)
            first = error
    if first is not None:
        raise first


def _write(folder: Path, out: Path | None, title: str, each: bool) -> None:
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
        echo(f"wrote {add_report(folder, title=title)}")
    else:
        _write_index(folder, each)


def _write_index(folder: Path, each: bool) -> None:
    """Write the contact sheet of a folder of results, and with ``each`` the page of every
    result.
    """
    from physic_core.batch.contact_sheet import (
        check_contact_sheet,
        find_results,
        write_contact_sheet,
    )
    from physic_core.errors import InputError
    from physic_core.io.report_file import add_report

    found = find_results(folder)
    check_contact_sheet(folder)
    for number, result in enumerate(found if each else (), 1):
        try:
            path = add_report(result)
        # the page states the error, and the other results get their pages
        except InputError as error:
            echo(f"[{number}/{len(found)}] {error}", err=True)
        else:
            echo(f"[{number}/{len(found)}] {path}", err=True)
    echo(f"wrote {write_contact_sheet(folder, found)}")


def _print_formats(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if not wanted:
        return
    from physic_core.cli.output import format_table
    from physic_core.discovery.plugins import find_exporters, missing_formats_hint

    rows = [("format", "suffix", "for", "content", "needs")]
    exporters = find_exporters()
    for exporter in exporters:
        each = exporter.record
        needs = [each.needs] if each.needs else []
        if each.packages:
            what = f"the extra '{each.extra}'" if each.extra else ", ".join(each.packages)
            needs.insert(0, f"{what} ({'not installed' if each.missing_packages else 'installed'})")
        rows.append(
            (
                each.name,
                " ".join(each.suffixes),
                each.audience,
                each.content,
                "; ".join(needs) or "-",
            )
        )
    echo(format_table(rows))
    for text in missing_formats_hint(exporters):
        echo(text)
    ctx.exit()


def _name_to(ctx: click.Context, _: click.Parameter, given: str | None) -> None:
    if given is not None:
        raise click.UsageError(f"no such option '--format': write --to {given}")


@click.command()
@click.argument("out", type=ResultPath())
@click.option(
    "--to", "name", metavar="FORMAT", help="A format of --list.  [default: by the suffix of -o]"
)
@click.option("--format", hidden=True, expose_value=False, callback=_name_to)
@click.option(
    "-o", "--out", "path", type=AnyPath(), help="File or folder to write.  [default: a file in OUT]"
)
@click.option(
    "--person",
    type=int,
    multiple=True,
    metavar="N",
    help="Only person N of the result; may be repeated.",
)
@click.option(
    "--up",
    type=click.Choice(["y", "z", "camera"]),
    help="Up axis.  [default: the format's convention]",
)
@click.option("--no-scene", is_flag=True, help="Omit scene and floor.")
@click.option("--body-model", type=AnyPath(), metavar="FILE", help="Your SMPLX_*.npz.")
@click.option(
    "--names",
    type=click.Choice(["smplx", "mixamo", "unreal", "unity", "lafan"]),
    help="Names of the bones.",
)
@click.option(
    "--skin", type=click.Choice(["photo", "neutral", "contact"]), help="Colours of the bodies."
)
@click.option(
    "--texture-size", type=click.Choice(["512", "1024", "2048", "4096"]), help="Texels per side."
)
@click.option("--contact-texture", is_flag=True, help="Also write contact as a UV texture.")
@click.option("--rigid", is_flag=True, help="People without joints (MJCF).")
@click.option(
    "--keep-lean", is_flag=True, help="People lean as in the photo, and may fall (MJCF, URDF)."
)
@click.option("--overwrite", is_flag=True, help="Replace files that exist.")
@click.option(
    "--list",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_formats,
    help="List the formats.",
)
def export(
    out: Path,
    name: str | None,
    path: Path | None,
    no_scene: bool,
    **options: Any,
) -> None:
    """Export the result in folder OUT to a format of another program.

    FBX is made of the GLB by Blender: the command is in docs/exports.md under FBX.
    """
    from physic_core.discovery.plugins import find_exporter

    if name is None and path is None:
        raise click.UsageError(
            "no format given: name one with --to, or a file with -o; --list prints the formats"
        )
    # An unknown format is reported before numpy is imported.
    find_exporter(name, "" if path is None or path.is_dir() else path.suffix)

    from physic_core.export import export_reconstruction
    from physic_core.io.result_folder import list_exports
    from physic_core.io.results import load_reconstruction

    done = export_reconstruction(
        load_reconstruction(out),
        out if path is None else path,
        name,
        scene=not no_scene,
        **{option: value for option, value in options.items() if value},
    )
    if path is None:
        list_exports(out, done.files)
    for note in done.notes:
        echo(f"note: {note}")
    top = min((len(file.parts) for file in done.files), default=0)
    below: dict[Path, int] = {}
    for file in done.files:
        size = file.stat().st_size
        if len(file.parts) > top:
            below[file.parent] = below.get(file.parent, 0) + 1
        else:
            echo(f"{file}  ({f'{size / 1e6:.1f} MB' if size > 99_950 else f'{size / 1e3:.0f} kB'})")
    for folder, count in below.items():
        echo(f"{folder}/  (files: {count})")


@click.command()
@click.argument("out", type=ResultPath())
@click.option(
    "-v",
    "--verbose",
    is_flag=True,
    help="Also print the time of each stage, and each check that is not ok.",
)
@click.option("--notes", is_flag=True, help="Print all notes, not the three most useful ones.")
def show(out: Path, verbose: bool, notes: bool) -> None:
    """Print the people, grade and warnings of the result in folder OUT, as `physic run` does at its
    end.
    """
    from physic_core.cli.result_summary import SHOWN_NOTES, print_summary

    print_summary(out, verbose=verbose, notes=None if notes else SHOWN_NOTES)
