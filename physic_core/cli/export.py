"""The command ``physic export``: write a result in the format of another program."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from physic_core.cli.output import echo


def _print_formats(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if not wanted:
        return
    from physic_core.cli.output import format_table
    from physic_core.discovery.catalog import EXPORTERS
    from physic_core.discovery.exporters import find_exporters
    from physic_core.discovery.plugins import explain_absence

    rows = [("format", "suffix", "for", "content", "needs")]
    for exporter in find_exporters():
        each = exporter.record
        needs = [each.needs] if each.needs else []
        if each.packages:
            what = f"the extra '{each.extra}'" if each.extra else ", ".join(each.packages)
            needs.insert(0, f"{what} ({'not installed' if each.missing_packages else 'installed'})")
        rows.append((each.name, " ".join(each.suffixes), each.audience, each.content, "; ".join(needs) or "-"))
    echo(format_table(rows))
    listed = {row[0] for row in rows}
    for distribution in dict.fromkeys(EXPORTERS.values()):
        if missing := [name for name, owner in EXPORTERS.items() if owner == distribution and name not in listed]:
            echo(f"{', '.join(missing)}: in {explain_absence(distribution)}")
    ctx.exit()


@click.command()
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--to", "name", metavar="FORMAT", help="A format of --list.  [default: by the suffix of -o]")
@click.option(
    "-o", "--out", "path", type=click.Path(path_type=Path), help="File or folder to write.  [default: a file in OUT]"
)
@click.option("--person", type=int, multiple=True, metavar="N", help="Only person N of the result; may be repeated.")
@click.option("--up", type=click.Choice(["y", "z", "camera"]), help="Up axis.  [default: the format's convention]")
@click.option("--no-scene", is_flag=True, help="Omit scene and floor.")
@click.option("--body-model", type=click.Path(path_type=Path), metavar="FILE", help="Your SMPLX_*.npz.")
@click.option("--names", type=click.Choice(["smplx", "mixamo", "unreal", "unity"]), help="Names of the bones.")
@click.option("--skin", type=click.Choice(["photo", "neutral", "contact"]), help="Colours of the bodies.")
@click.option("--texture-size", type=click.Choice(["512", "1024", "2048", "4096"]), help="Texels per side.")
@click.option("--contact-texture", is_flag=True, help="Also write contact as a UV texture.")
@click.option("--rigid", is_flag=True, help="People without joints (MJCF).")
@click.option(
    "--balance",
    is_flag=True,
    help="Rotate people on their feet until the centre of mass is over the soles (MJCF, URDF).",
)
@click.option("--overwrite", is_flag=True, help="Replace files that exist.")
@click.option(
    "--list", is_flag=True, is_eager=True, expose_value=False, callback=_print_formats, help="List the formats."
)
def export(
    out: Path,
    name: str | None,
    path: Path | None,
    no_scene: bool,
    **options: Any,
) -> None:
    """Export the result in folder OUT to a format of another program."""
    from physic_core.discovery.exporters import find_exporter

    if name is None and path is None:
        raise click.UsageError("no format given: name one with --to, or a file with -o; --list prints the formats")
    # An unknown format is reported before numpy is imported.
    find_exporter(name, "" if path is None or path.is_dir() else path.suffix)

    from physic_core.io.results import load_reconstruction
    from physic_core.visual.export.write import export_reconstruction

    done = export_reconstruction(
        load_reconstruction(out),
        out if path is None else path,
        name,
        scene=not no_scene,
        **{option: value for option, value in options.items() if value},
    )
    for note in done.notes:
        echo(f"note: {note}")
    for file in done.files:
        size = file.stat().st_size
        echo(f"{file}  ({f'{size / 1e6:.1f} MB' if size > 99_950 else f'{size / 1e3:.0f} kB'})")
