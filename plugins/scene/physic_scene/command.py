"""The command ``physic scene``: reconstruct several photos of one moment, and write one folder of
results.
"""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from physic_core.cli.arguments import AnyPath, Number, Numbers, configuration_options

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core import KnownSizes
    from physic_scene.calibration import KnownCamera
    from physic_scene.types import SceneResult


def _known_sizes(stature: tuple[float, ...] | None, age: float | None) -> KnownSizes:
    from physic_core import KnownSizes

    try:
        return KnownSizes(stature=stature or (), age=() if age is None else (age,))
    except ValueError as error:  # which names the size
        raise click.UsageError(str(error)) from error


def _files_of_photos(count: int, **given: Sequence[Path]) -> list[dict[str, str]]:
    """Return the settings of each photo from options that are given once for each, or not at
    all.
    """
    for name, paths in given.items():
        if len(paths) not in (0, count):
            raise click.UsageError(
                f"--{name} is given {len(paths)} times for {count} photos: give it once for each"
            )
    return [
        {name: str(paths[i].absolute()) for name, paths in given.items() if paths}
        for i in range(count)
    ]


def _warn_of_order(photos: Sequence[Path], cameras: Sequence[KnownCamera | None]) -> None:
    from physic_core.cli.output import echo

    pairs = zip(photos, cameras, strict=True)
    order = ", ".join(f"{photo.name} is {one and one.name}" for photo, one in pairs)
    echo(
        f"warning: no photo has the name of a camera, so cameras are taken in order: {order}",
        err=True,
    )


@click.command()
@click.argument("photos", metavar="PHOTO PHOTO...", nargs=-1, required=True, type=AnyPath())
@click.option("-o", "--out", type=AnyPath(), required=True, help="Folder for the results.")
@click.option("--overwrite", is_flag=True, help="Replace another photo's result.")
@configuration_options
@click.option(
    "--cameras",
    "calibration",
    metavar="FILE",
    type=AnyPath(),
    help="Calibrated cameras of some or all photos: TOML, or the files of another tool.",
)
@click.option(
    "--camera-unit",
    "unit_m",
    metavar="METERS",
    type=Number(0, min_open=True),
    help="Length of the unit of --cameras, such as 0.01 for centimeters.  [default: 1]",
)
@click.option(
    "--stature",
    type=Numbers("meters,..."),
    help="Known standing heights: one for all people, or from left to right in the first photo, 0 "
    "where unknown.",
)
@click.option("--age", metavar="YEARS", type=Number(), help="Known age of all people.")
@click.option(
    "--bodies",
    metavar="FILE",
    type=AnyPath(),
    multiple=True,
    help="Bodies of another program, as of `physic run`: once for each photo, in their order.",
)
@click.option(
    "--masks",
    metavar="FILE",
    type=AnyPath(),
    multiple=True,
    help="Masks from another program, as in `physic run`; repeat once per photo, in order.",
)
@click.option("-q", "--quiet", is_flag=True, help="Print only warnings and errors.")
def scene(
    photos: tuple[Path, ...],
    out: Path,
    overwrite: bool,
    file: Path | None,
    preset: str | None,
    overrides: tuple[str, ...],
    calibration: Path | None,
    unit_m: float | None,
    stature: tuple[float, ...] | None,
    age: float | None,
    bodies: tuple[Path, ...],
    masks: tuple[Path, ...],
    quiet: bool,
) -> None:
    """Reconstruct one moment from two to eight photos.

    Writes the files of `physic run`, cameras.json and photos.png. The frame is that of
    the photo that shows the most people.
    """
    start = time.monotonic()
    from physic_core import load_config
    from physic_core.cli.output import echo, reserve_folder
    from physic_core.cli.result_summary import print_summary
    from physic_scene.calibration import read_calibration
    from physic_scene.output import save_scene
    from physic_scene.scene_pipeline import ScenePipeline

    known = _known_sizes(stature, age)
    settings = _files_of_photos(len(photos), bodies=bodies, masks=masks)
    if unit_m is not None and calibration is None:
        raise click.UsageError(
            "--camera-unit is the unit of a file of --cameras: give both, or leave it out"
        )
    sizes, digests = _sizes_and_digests(photos)
    cameras = None if calibration is None else read_calibration(calibration, photos, sizes, unit_m)
    if cameras and any(one and one.by_order for one in cameras):
        _warn_of_order(photos, cameras)
    for photo in (p for p, one in zip(photos, cameras or (), strict=False) if one is None):
        echo(f"warning: {photo.name} has no camera in {calibration}: it is estimated", err=True)
    all_photos = " ".join(digests)

    def progress(name: str, done: int, total: int) -> None:
        if not quiet:
            echo(f"[{done + 1}/{total}] {name}", err=True)

    with (
        reserve_folder(out, all_photos, overwrite=overwrite),
        ScenePipeline(load_config(file, preset=preset, overrides=overrides)) as solver,
    ):
        result = solver(photos, cameras=cameras, known=known, settings=settings, progress=progress)
        save_scene(
            result,
            str(out),
            overwrite=overwrite,
            page=result.reference_photo.name,
            photos=all_photos,
        )
    if quiet:
        for text in result.reconstruction.warnings:
            echo(f"warning: {text}", err=True)
    else:
        echo(_photo_table(result))
        print_summary(out, seconds=time.monotonic() - start)


def _sizes_and_digests(photos: tuple[Path, ...]) -> tuple[list[tuple[int, int]], set[str]]:
    """Return width and height of the upright photo files, px, and the photos' digests.

    Raises:
        InputError: a photo cannot be read, which is known before the first one is reconstructed.
    """
    from physic_core import read_photo

    read = [read_photo(path) for path in photos]
    sizes = [photo.file_size or (photo.image.shape[1], photo.image.shape[0]) for photo in read]
    return sizes, {part for photo in read for part in photo.digest.split()}


def _photo_table(result: SceneResult) -> str:
    """Return a line for each photo, with its people as they are numbered in the saved result."""
    from physic_core.cli.output import format_table

    rows = [("photo", "people", "rotation +-", "position +-", "keypoints off")]
    for photo in result.photos:
        own = photo.index == result.reference
        camera = photo.camera
        rows.append(
            (
                photo.name,
                ", ".join(map(str, photo.shown)),
                "reference" if own else f"{math.degrees(camera.rotation_sigma):.1f} deg",
                "reference" if own else f"{camera.position_sigma:.2f} m",
                f"{100 * photo.reprojection:.1f} % of stature",
            )
        )
    return format_table(rows)
