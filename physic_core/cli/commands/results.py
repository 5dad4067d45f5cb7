"""The commands on saved results: ``physic export`` (the format of another program), and ``physic
show`` (the summary).
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import click

from physic_core.cli.arguments import AnyPath, ResultPath, WholeNumber
from physic_core.cli.output import echo, format_table


def _print_formats(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if not wanted:
        return
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


def _refuse_format_option(ctx: click.Context, _: click.Parameter, given: str | None) -> None:
    if given is not None:
        raise click.UsageError(f"no such option '--format': write --to {given}")


@click.command()
@click.argument("out", type=ResultPath())
@click.option(
    "--to", "name", metavar="FORMAT", help="A format of --list.  [default: by the suffix of -o]"
)
@click.option("--format", hidden=True, expose_value=False, callback=_refuse_format_option)
@click.option(
    "-o", "--out", "path", type=AnyPath(), help="File or folder to write.  [default: a file in OUT]"
)
@click.option(
    "--person",
    type=WholeNumber(0),
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
    type=click.Choice(["smplx", "mixamo", "unreal", "unity", "vrm"]),
    help="Names of the bones.",
)
@click.option(
    "--skin", type=click.Choice(["photo", "neutral", "contact"]), help="Colors of the bodies."
)
@click.option(
    "--texture-size", type=click.Choice(["512", "1024", "2048", "4096"]), help="Texels per side."
)
@click.option("--contact-texture", is_flag=True, help="Also write contact as a UV texture.")
@click.option("--plain", is_flag=True, help="Leave out contact and guessed colors (GLB).")
@click.option(
    "--rest-pose",
    is_flag=True,
    help="Store people at rest; the animation has the pose (GLB).",
)
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

    For FBX, export a GLB, and convert it in Blender: see docs/exports.md.
    """
    from physic_core.discovery.plugins import find_exporter

    if name is None and path is None:
        raise click.UsageError(
            "no format given: name one with --to, or a file with -o; --list prints the formats"
        )
    # An unknown format is reported before numpy is imported.
    find_exporter(name, "" if path is None or path.is_dir() else path.suffix)

    from physic_core.export import export_reconstruction
    from physic_core.io.result_folder import add_result_files
    from physic_core.io.results import load_reconstruction

    done = export_reconstruction(
        load_reconstruction(out),
        out if path is None else path,
        name,
        scene=not no_scene,
        write=add_result_files if path is None else None,
        **{option: value for option, value in options.items() if value},
    )
    for note in done.notes:
        echo(f"note: {note}")
    top = min((len(file.parts) for file in done.files), default=0)
    for file in done.files:
        if len(file.parts) == top:
            size = file.stat().st_size
            size_text = f"{size / 1e6:.1f} MB" if size > 99_950 else f"{size / 1e3:.0f} kB"
            echo(f"{file}  ({size_text})")
    below = Counter(file.parent for file in done.files if len(file.parts) > top)
    for folder, count in below.items():
        echo(f"{folder}/  (files: {count})")


def _print_columns(context: click.Context, _: click.Parameter, value: object) -> None:
    """Print the columns of the tables, and end."""
    if not value:
        return
    from physic_core.types import PERSON_COLUMNS, SUMMARY_COLUMNS

    for file, columns in (("people.csv", PERSON_COLUMNS), ("summary.csv", SUMMARY_COLUMNS)):
        echo(f"{file}:")
        echo(format_table([(f"  {name}", one.meaning) for name, one in columns.items()]))
    context.exit()


@click.command()
@click.argument("out", type=ResultPath())
@click.option(
    "-v",
    "--verbose",
    is_flag=True,
    help="Also print the time of each stage, and each check that is not ok.",
)
@click.option("--notes", is_flag=True, help="Print all notes, not the three most useful ones.")
@click.option(
    "--columns",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_columns,
    help="Print what the columns of people.csv and summary.csv hold, and exit.",
)
def show(out: Path, verbose: bool, notes: bool) -> None:
    """Print the people, usable marks and warnings of the result in folder OUT, as `physic run` does
    at its end.
    """
    from physic_core.cli.result_summary import SHOWN_NOTES, print_summary

    print_summary(out, verbose=verbose, notes=None if notes else SHOWN_NOTES)
