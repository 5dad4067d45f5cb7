"""The command ``physic run``: reconstruct one photo and write a folder of results."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from physic_core.cli.arguments import AnyPath, Device, Number, Numbers, configuration_options
from physic_core.cli.output import collect_plugin_messages, echo, reserve_folder, show_progress

if TYPE_CHECKING:
    from physic_core.types import Reconstruction


def _setting_option(
    option: str, path: str, **attributes: Any
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Add an option that sets the configuration value at a dotted path, in the context's object."""

    def store(ctx: click.Context, parameter: click.Parameter, given: Any) -> None:
        if given is not None and given is not False and given != ():
            table, _, key = path.partition(".")
            value = False if option.startswith("--no-") else given
            ctx.ensure_object(dict)[option] = {table: {key: value}}

    return click.option(option, callback=store, expose_value=False, **attributes)


def _single_photo(ctx: click.Context, parameter: click.Parameter, photos: tuple[Path, ...]) -> Path:
    if len(photos) != 1:
        raise click.UsageError(
            f"PHOTO is one file (got {', '.join(map(str, photos))}): `physic batch PHOTO... -o "
            "FOLDER` takes several; write the value of an option without blanks, as --stature "
            "1.7,1.8 or --set KEY=VALUE"
        )
    return photos[0]


def _suggest_focal_length(result: Reconstruction) -> None:
    if not result.intrinsics.known:
        what = "widths and heights in the scene" if result.scene.measured else "all distances"
        echo(
            f"{what} follow the focal length: if you know it, give --focal-px PX, in px of the "
            "photo file, or --intrinsics fx,fy,cx,cy",
            err=True,
        )


def _check_flags(flags: Collection[str], *, open_page: bool, report: bool | None) -> None:
    if "--focal-px" in flags and "--intrinsics" in flags:
        raise click.UsageError("--focal-px and --intrinsics both set the camera: give only one")
    if open_page and report is False:
        raise click.UsageError("--no-report writes no page that --open could show: leave one out")


_SAVE = (
    "numbers: JSON and arrays. pictures: the same, preview, combined.glb and the page. people: "
    "JSON and arrays of the people."
)

_REPORT = "Write report.html, a 3D page for a browser. [default: with --save pictures]"

_KEYPOINTS = (
    "Keypoints that replace detected ones, px of the photo file: CSV with person (as in "
    "people.csv), joint, x, y; or COCO JSON."
)

_BODIES = "Bodies: .npz of `physic export --to bodies`, or from another program (docs/bodies.md)."
_MASKS = (
    "Masks of the people: COCO .json, label .png, .npz (N, H, W), a folder of SAM, or .txt of "
    "polygons."
)
_PERSON = "Reconstruct only the person at this pixel of the photo file; may be repeated."
_IGNORE = "Leave out the person at this pixel: a reflection, a picture, a figure; may be repeated."


@click.command()
@click.argument(
    "photo", metavar="PHOTO", type=AnyPath(), nargs=-1, required=True, callback=_single_photo
)
@click.option(
    "-o",
    "--out",
    type=AnyPath(),
    help="Folder for the results.  [default: photo-physic for photo.jpg]",
)
@click.option("--overwrite", is_flag=True, help="Replace another photo's result.")
@click.option(
    "--save",
    type=click.Choice(("pictures", "numbers", "people")),
    default="pictures",
    show_default=True,
    help=_SAVE,
)
@click.option("--report/--no-report", default=None, help=_REPORT)
@click.option("--open", "open_page", is_flag=True, help="Open the page in a browser.")
@configuration_options
@_setting_option(
    "--focal-px",
    "photo.focal_px",
    type=Number(),
    metavar="PX",
    help="Focal length in px of the photo file.",
)
@_setting_option(
    "--intrinsics",
    "photo.intrinsics",
    type=Numbers("fx,fy,cx,cy"),
    help="Camera in px of the photo file.",
)
@_setting_option(
    "--distortion",
    "photo.distortion",
    type=Numbers("k1,k2,p1,p2,k3"),
    help="Lens distortion of --intrinsics, in OpenCV's order.",
)
@_setting_option("--person", "photo.person", type=Numbers("x,y"), multiple=True, help=_PERSON)
@_setting_option(
    "--box",
    "photo.box",
    type=Numbers("x0,y0,x1,y1"),
    multiple=True,
    help="Like --person, by a box around a person; may be repeated.",
)
@_setting_option("--ignore", "photo.ignore", type=Numbers("x,y"), multiple=True, help=_IGNORE)
@_setting_option(
    "--depth",
    "photo.depth",
    metavar="FILE",
    help="Depth map of the photo: .npy, .exr or .pfm in m, .png in mm, or .heic.",
)
@_setting_option(
    "--depth-unit",
    "photo.depth_unit",
    metavar="UNIT",
    help="Another unit of --depth: mm, cm, m, ft, or such as 1/5000.",
)
@_setting_option(
    "--pointmap",
    "photo.pointmap",
    metavar="FILE",
    help="Point map of the photo: .npy (H, W, 3), or .npz.",
)
@_setting_option("--keypoints", "photo.keypoints", metavar="FILE", help=_KEYPOINTS)
@_setting_option("--bodies", "photo.bodies", metavar="FILE", help=_BODIES)
@_setting_option("--masks", "photo.masks", metavar="FILE", help=_MASKS)
@_setting_option(
    "--stature",
    "photo.stature",
    type=Numbers("meters,..."),
    help="Known standing height, meters: one for all people, or one per person from left to "
    "right, 0 where unknown.",
)
@_setting_option(
    "--age",
    "photo.age",
    type=Numbers("years,..."),
    help="Known ages in years: one for all people, or one per person from left to right, 0 where "
    "unknown.",
)
@_setting_option(
    "--camera-height",
    "photo.camera_height",
    type=Number(),
    metavar="METERS",
    help="Known camera height above the floor.",
)
@_setting_option(
    "--known-length",
    "photo.known_length",
    type=Numbers("x1,y1,x2,y2,meters"),
    multiple=True,
    help="Two pixels of the photo file and the true distance between what they show; may "
    "be repeated.",
)
@_setting_option(
    "--require-people",
    "photo.require_people",
    is_flag=True,
    help="Fail if the photo shows no person.",
)
@_setting_option(
    "--device", "run.device", type=Device(), metavar="NAME", help="cpu, cuda or cuda:N."
)
@_setting_option(
    "--low-memory",
    "run.low_memory",
    is_flag=True,
    help="Close each backend right after its last use.",
)
@click.option(
    "-v",
    "--verbose",
    is_flag=True,
    help="Also print each network, the time of each stage, and all messages.",
)
@click.option("-q", "--quiet", is_flag=True, help="Print only warnings and errors.")
@_setting_option(
    "--no-cache",
    "run.cache",
    is_flag=True,
    help="Do not read or write the cache of backend outputs.",
)
@click.pass_context
def run(
    ctx: click.Context,
    photo: Path,
    out: Path | None,
    overwrite: bool,
    save: str,
    report: bool | None,
    open_page: bool,
    file: Path | None,
    preset: str | None,
    overrides: tuple[str, ...],
    verbose: bool,
    quiet: bool,
) -> None:
    """Reconstruct people, scene and contact from PHOTO, one image file; `physic batch` takes
    folders.
    """
    flags: dict[str, dict[str, Any]] = ctx.ensure_object(dict)
    _check_flags(flags, open_page=open_page, report=report)
    from physic_core.configuration.model import load_config
    from physic_core.configuration.resolve import require_available, resolve

    # Fast checks come first: no network is loaded before config, files, device and output folder
    # are checked.
    plan = resolve(load_config(file, preset=preset, overrides=overrides, flags=flags))
    require_available(plan)
    report = _writes_report(open_page or report, save)
    from physic_core.io.result_folder import file_digest

    folder = out or Path(f"{photo.stem}-physic")
    cached = plan.config.run.cache
    with (
        _report_kept_files(folder, cached=cached),
        reserve_folder(folder, file_digest(photo), overwrite=overwrite),
    ):
        from physic_core.pipeline.run import reconstruct

        with collect_plugin_messages() as messages, show_progress(quiet) as progress:
            result = reconstruct(photo, plan, progress=progress)
        from physic_core.io.result_folder import PEOPLE_TABLE, people_csv
        from physic_core.io.results import save_reconstruction

        beside = {PEOPLE_TABLE: partial(people_csv, result, photo.name)}
        title = photo.name if report else None
        save_reconstruction(result, folder, save, overwrite=overwrite, beside=beside, page=title)
    if quiet:
        from physic_core.io.results import read_record

        for text in read_record(folder).warnings:  # those of pictures, too
            echo(f"warning: {text}", err=True)
    elif verbose:
        for text in messages:
            echo(text, err=True)
    if not quiet:
        from physic_core.cli.result_summary import print_summary

        print_summary(folder, verbose=verbose)
        _suggest_focal_length(result)
    if open_page:
        _open_in_browser(folder / "report.html")


@contextmanager
def _report_kept_files(folder: Path, *, cached: bool) -> Iterator[None]:
    """Inside the block, Ctrl-C says what it leaves in the folder and in the cache."""
    try:
        yield
    except KeyboardInterrupt as error:
        kept = (
            "the cache keeps outputs of the backends that finished"
            if cached
            else "without the cache nothing is kept"
        )
        raise KeyboardInterrupt(f"no new result in {folder}; {kept}") from error


def _open_in_browser(page: Path) -> None:
    import webbrowser

    if not webbrowser.open(page.absolute().as_uri()):
        echo(f"no browser was found: open {page} yourself", err=True)


def _writes_report(wanted: bool | None, save: str) -> bool:
    """Return whether to write the page: by default, with pictures.

    Raises:
        PackageMissingError: page or pictures are wanted, and no plugin makes them.
    """
    report = save == "pictures" if wanted is None else wanted
    if report or save == "pictures":
        from physic_core.pictures import require_pictures

        require_pictures()
    return report
