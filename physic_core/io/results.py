"""Write a reconstruction to a folder and read it back: a document, arrays, and pictures if wanted.

``reconstruction.json`` has all values, and the names and SHA-256 of the other files;
:func:`read_record` reads nothing else. ``reconstruction.npz`` has the arrays, by the names of
:mod:`physic_core.files.serialization`. docs/file-format.md describes both.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.discovery.error_text import left_out_warning, make_optional_parts
from physic_core.errors import ConfigError, InputError, PackageMissingError
from physic_core.files.atomic import open_regular, read_regular, unreadable
from physic_core.files.names import UntrustedName, paths_inside
from physic_core.files.npz import MAX_ARRAY_BYTES, read_arrays, read_names, write_arrays
from physic_core.files.serialization import Arrays, join, split
from physic_core.files.text import parse_json, to_json
from physic_core.geometry.world_frame import world_from_camera
from physic_core.interfaces.checks import check_camera
from physic_core.io.result_folder import (
    ARRAYS_FILE,
    DOCUMENT_FILE,
    MAX_DOCUMENT_BYTES,
    SCHEMA,
    file_digest,
    prepare_result_folder,
    run_of_document,
    write_result_files,
)
from physic_core.pictures import GLB_FILE, PREVIEW_FILE, REPORT_FILE, make_pictures
from physic_core.types import (
    NO_PARTNER,
    CheckResult,
    Intrinsics,
    Reconstruction,
    StageRecord,
    UnposedPerson,
)
from physic_core.types.tables import person_rows

if TYPE_CHECKING:
    from physic_core.types import AnyArray, Float32Array, UInt8Array

SCHEMA_VERSION = 9
"""Version of documents that are written and read."""

SAVE = ("pictures", "numbers", "people")
"""What to save. numbers: document and arrays. pictures: the same, ``preview.png`` and
``combined.glb``. people: document and arrays without photo and scene.
"""

_FRAME = {
    "axes": "OpenCV camera: x right, y down, z forward; origin at the camera",
    "units": "meters, radians, seconds, pixels",
    "pixels": "integer coordinates are pixel centers; (0, 0) is the center of the top left pixel",
    "world": "x right, y up, z backward, floor at y = 0 below the camera: world_from_camera times "
    "points of the camera frame; GLB files are in it",
}
_OF_SCENE = ("image", "scene.")
_RUN = "run"
_ROWS = "the table of people"
# Of bodies: rounding by less than a thousandth of a millimetre saves a sixth of the bytes.
_STEPS_PER_METRE = 1 << 19
_DEPTH_BITS = 15  # of the mantissa: 0.0015 %
_NORMAL_STEPS = 127
_RAY_TOLERANCE = 2e-5  # of the depth; float32 arithmetic along a ray is within 1e-6
_UNIT_TOLERANCE = 0.01
_SMALL = 256 << 20
_MAX_RATIO = 50
"""Arrays may have 256 MB plus 50 times the size of their file: photos and depth compress by less
than 10.
"""


def save_reconstruction(
    reconstruction: Reconstruction,
    folder: str | os.PathLike[str],
    save: str = "pictures",
    *,
    overwrite: bool = False,
    beside: Mapping[str, Callable[[], bytes]] | None = None,
    page: str | None = None,
    photos: str = "",
) -> tuple[Path, ...]:
    """Write the files of a result to a folder.

    The folder is new, empty, or has an earlier result of the same photo (of any photo with
    ``overwrite``) without a change, which is replaced as a whole.

    Args:
        reconstruction: what to save.
        folder: created if missing.
        save: one of :data:`SAVE`.
        overwrite: whether to replace another photo's result.
        beside: names of further files, which are files of the result too, and what returns their
            content.
        page: title of ``report.html``; None for no page.
        photos: digests of all photos of one moment, whose earlier results are replaced; "" for that
            of the result.

    Pictures, tables, and files ``beside`` that cannot be made are a warning of the saved result.

    Returns:
        Paths of the written files.

    Raises:
        ConfigError: ``save`` is not valid.
        OutputError: the folder cannot be written, or has a file of the user.
        PackageMissingError: no plugin makes the pictures; the numbers are written without them.
    """
    if save not in SAVE:
        raise ConfigError(f"what to save is one of {', '.join(SAVE)} (got '{save}')")
    folder = Path(folder)
    photos = photos or reconstruction.photo
    pictures = [GLB_FILE, PREVIEW_FILE] if save == "pictures" else []
    if page is not None:
        pictures.append(REPORT_FILE)
    prepare_result_folder(folder, photos, overwrite=overwrite)
    made, warnings = make_optional_parts(
        {_ROWS: partial(person_rows, reconstruction), **(beside or {})}
    )
    reconstruction = reconstruction.with_warnings(*warnings)
    rows = made.pop(_ROWS, [])
    arrays: Arrays = {}
    document = _build_document(reconstruction, rows, arrays)
    if save == "people":
        arrays = {name: array for name, array in arrays.items() if not name.startswith(_OF_SCENE)}
    arrays = _compact(arrays, reconstruction.intrinsics) | {_RUN: np.array(document["run"])}
    contents, failure = _result_files(reconstruction, arrays, pictures, page or "")
    if isinstance(failure, Exception) and not isinstance(failure, PackageMissingError):
        return save_reconstruction(
            reconstruction.with_warnings(left_out_warning("the pictures", failure)),
            folder,
            "people" if save == "people" else "numbers",
            overwrite=overwrite,
            beside={name: partial(bytes, content) for name, content in made.items()},
            photos=photos,
        )
    write_result_files(folder, document, contents | made, photos, overwrite=overwrite)
    if failure is not None:
        raise failure
    return tuple(folder / name for name in (DOCUMENT_FILE, *contents, *made))


def load_reconstruction(folder: str | os.PathLike[str]) -> Reconstruction:
    """Read a reconstruction that :func:`save_reconstruction` wrote, and check that its files are
    complete.

    Raises:
        InputError: a file is missing, damaged, changed, of another run, or of another version; the
            result has only people.
    """
    document, arrays = _read_document_and_arrays(Path(folder))
    try:
        if "image" not in arrays:
            raise ValueError(
                "it was saved without photo and scene (--save people; numbers has both): "
                "physic_core.load_people reads it"
            )
        camera = join(Intrinsics, document["intrinsics"], {})
        if wrong := [*check_camera(camera, camera.height, camera.width)]:
            raise ValueError("; ".join(wrong))
        sizes = {"H": camera.height, "W": camera.width}
        if arrays["image"].shape != (camera.height, camera.width, 3):
            raise ValueError(f"image has the shape {arrays['image'].shape}, not that of the camera")
        result: Reconstruction = join(
            Reconstruction, document, _expanded(arrays, camera), sizes=sizes
        )
        _check_indices(result)
        _check_floor(result)
        _check_digest(Path(folder), document)
    except InputError:
        raise
    except Exception as error:  # dataclasses raise many classes for invalid values
        raise damaged(Path(folder), error) from error
    return result


def load_people(folder: str | os.PathLike[str]) -> dict[str, AnyArray]:
    """Read the arrays of a result but those of photo and scene, whatever was saved.

    Returns:
        The arrays by name, such as ``people.0.vertices`` (V, 3), metres, in the frame of the OpenCV
        camera.

    Raises:
        InputError: a file is missing, damaged, of another run, or of another version.
    """
    document, arrays = _read_document_and_arrays(Path(folder))
    _check_digest(Path(folder), document)
    return {name: array for name, array in arrays.items() if not name.startswith(_OF_SCENE)}


def read_image(folder: str | os.PathLike[str]) -> UInt8Array | None:
    """Read the image (H, W, 3) uint8 of a result alone; None if it was saved without.

    Raises:
        InputError: a file is missing, damaged, of another run, or of another version.
    """
    document, arrays = _read_document_and_arrays(Path(folder), ["image"])
    _check_digest(Path(folder), document)
    image = arrays.get("image")
    if image is not None and (image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8):
        raise damaged(Path(folder), ValueError(f"image is {image.dtype.name} {image.shape}"))
    return image


def read_document(folder: Path) -> dict[str, Any]:
    """Read ``reconstruction.json`` of a folder; NaN and infinities stay strings.

    Raises:
        InputError: it is missing, damaged, not a reconstruction, or of another version.
    """
    path = UntrustedName(DOCUMENT_FILE).inside(folder)
    try:
        document = parse_json(read_regular(path, MAX_DOCUMENT_BYTES))
        if not isinstance(document, dict) or document.get("schema") != SCHEMA:
            raise ValueError("it does not describe a reconstruction")
        if document.get("schema_version") != SCHEMA_VERSION:
            raise ValueError(
                f"its version is {document.get('schema_version')!r:.20}, this PhySIC reads "
                f"{SCHEMA_VERSION}"
            )
    except OSError as error:
        raise _unreadable(path, error) from error
    except ValueError as error:
        raise damaged(path, error) from error
    return document


def _build_document(
    reconstruction: Reconstruction, rows: list[dict[str, Any]], arrays: Arrays
) -> dict[str, Any]:
    """Return the document of a result without its files, and add its arrays to ``arrays``."""
    texts = {name: to_json(getattr(reconstruction, name)) for name in ("config", "diagnostics")}
    values = split(replace(reconstruction, **texts), arrays)
    frame = _FRAME | {"world_from_camera": world_from_camera(reconstruction.scene.level).tolist()}
    document = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "run": "",
        "frame": frame,
        "rows": to_json(rows),
        **values,
    }
    return document | {"run": run_of_document(document)}


def _result_files(
    reconstruction: Reconstruction, arrays: Arrays, pictures: Collection[str], title: str
) -> tuple[dict[str, bytes], BaseException | None]:
    """Return the contents of the arrays' file, of the pictures and the page, and the error if one
    of these fails.
    """
    stream = BytesIO()
    made, failure = dict[str, bytes](), None
    with ThreadPoolExecutor(1, "arrays") as second:
        written = second.submit(write_arrays, stream, arrays)
        try:
            if pictures:
                made = make_pictures(reconstruction, pictures, title)
        except BaseException as error:  # an interrupted run keeps its numbers
            failure = error
        written.result()
    return {ARRAYS_FILE: stream.getvalue(), **made}, failure


def _read_document_and_arrays(
    folder: Path, names: Collection[str] | None = None
) -> tuple[dict[str, Any], Arrays]:
    """Read the document of a result, and its arrays, or those of some names that it has."""
    document = read_document(folder)
    path = UntrustedName(ARRAYS_FILE).inside(folder)
    try:
        with open_regular(path) as stream:
            there = read_names(stream)
            wanted = there if names is None else [name for name in there if name in {*names, _RUN}]
            limit = min(MAX_ARRAY_BYTES, _SMALL + _MAX_RATIO * os.fstat(stream.fileno()).st_size)
            arrays = read_arrays(stream, wanted, limit=limit)
        if str(arrays.pop(_RUN)) != document["run"]:
            raise ValueError(f"it is of another run than {DOCUMENT_FILE}")
    except OSError as error:
        raise _unreadable(path, error) from error
    # zipfile, zlib and numpy raise a dozen classes for flipped and missing bytes
    except Exception as error:
        raise damaged(path, error) from error
    return document, arrays


def _check_digest(folder: Path, document: Mapping[str, Any]) -> None:
    """Raise InputError unless the arrays have the SHA-256 that the document of their result states.

    The last check: others name what is wrong.
    """
    stated = document["files"].get(ARRAYS_FILE) if isinstance(document.get("files"), dict) else None
    if file_digest(folder / ARRAYS_FILE) != stated:
        wrong = (
            f"its SHA-256 is not the one that {DOCUMENT_FILE} states, so it was changed "
            f"since; copy it again"
        )
        raise damaged(folder / ARRAYS_FILE, ValueError(wrong))


def _unreadable(path: Path, error: OSError) -> InputError:
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        below = (path.parent.glob(f"{each}/{path.name}") for each in ("photos/*/*", "*"))
        one = next(itertools.chain.from_iterable(below), None)
        which = "" if one is None else f", or the folder of one photo, such as {one.parent}"
        return InputError(
            f"cannot read {path}: there is no such file; name the folder of a finished run{which}"
        )
    return InputError(f"cannot read {path}: {unreadable(error)}")


def damaged(path: Path, error: Exception) -> InputError:
    """Return the error for a file, or a folder, whose content cannot be used."""
    text = f"it has no {error.args[0]}" if isinstance(error, KeyError) else str(error)
    return InputError(
        f"cannot read {path}: {text[:300]}; run the reconstruction again"
    )  # the message of a library may quote the file


def _check_indices(result: Reconstruction) -> None:
    """Raise ValueError if faces or contacts name a vertex or a partner that is not there."""
    limits: dict[str, tuple[AnyArray, int, int]] = {}
    if result.people:
        limits["faces"] = result.faces, 0, len(result.people[0].vertices)
    for index, person in enumerate(result.people):
        if person.contact_partner is not None:
            partners = len(result.contact_partners)
            limits[f"people.{index}.contact_partner"] = person.contact_partner, NO_PARTNER, partners
    for name, (ids, least, count) in limits.items():
        if ids.size and (ids.min() < least or ids.max() >= count):
            raise ValueError(f"{name} has {ids.min()} to {ids.max()}, and there are {count}")


def _check_floor(result: Reconstruction) -> None:
    floor = result.scene.floor
    normal = None if floor is None else floor.normal
    for name, unit in (("scene.floor.normal", normal), ("scene.up", result.scene.up)):
        if unit is not None and not abs(np.linalg.norm(unit) - 1) < _UNIT_TOLERANCE:
            raise ValueError(f"{name} is not of length 1: {unit.tolist()}")


def _compact(arrays: Arrays, camera: Intrinsics) -> Arrays:
    """Return arrays as they are stored: a third of the bytes, with errors that docs/file-format.md
    states.
    """
    small = {
        name: _rounded_to_grid(array)
        if name.endswith((".vertices", ".joints", ".floor_points"))
        else array
        for name, array in arrays.items()
    }
    if "scene.points" in small:
        points = small["scene.points"]
        depth = _round_mantissa(points[..., 2])
        near = (
            np.abs(_pixel_rays(camera) * depth[..., None] - points)
            <= _RAY_TOLERANCE * np.abs(points[..., 2:]) + 1e-6
        )
        if near.all():
            del small["scene.points"]
            small["scene.depth"] = depth
        small["scene.normals"] = np.round(_NORMAL_STEPS * small["scene.normals"]).astype(np.int8)
        small["scene.colors_change"] = small.pop("scene.colors") - small["image"]
    return small


def _expanded(arrays: Arrays, camera: Intrinsics) -> Arrays:
    """Return the arrays of a result from their stored form."""
    expanded = dict(arrays)
    if "scene.depth" in expanded:
        expanded["scene.points"] = _pixel_rays(camera) * expanded.pop("scene.depth")[..., None]
    normals = expanded["scene.normals"].astype(np.float32)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    expanded["scene.normals"] = normals / np.where(length > 0, length, 1)
    expanded["scene.colors"] = expanded.pop("scene.colors_change") + expanded["image"]
    return expanded


def _rounded_to_grid(metres: AnyArray) -> Float32Array:
    return (np.round(metres.astype(np.float64) * _STEPS_PER_METRE) / _STEPS_PER_METRE).astype(
        np.float32
    )


def _round_mantissa(values: AnyArray) -> Float32Array:
    drop = np.uint32(23 - _DEPTH_BITS)
    bits = np.ascontiguousarray(values, np.float32).view(np.uint32)
    rounded = ((bits + (np.uint32(1) << (drop - np.uint32(1)))) >> drop << drop).view(np.float32)
    return np.where(np.isfinite(values), rounded, values)


def _pixel_rays(camera: Intrinsics) -> Float32Array:
    """Return the rays (H, W, 3) of the pixels, with z = 1."""
    x, y = np.meshgrid(
        (np.arange(camera.width) - camera.cx) / camera.fx,
        (np.arange(camera.height) - camera.cy) / camera.fy,
    )
    return np.stack([x, y, np.ones_like(x)], axis=-1).astype(np.float32)


@dataclass(frozen=True)
class ResultRecord:
    """A result without arrays.

    Attributes:
        files: name -> SHA-256 of each file but the document.
        rows: of the people, see :func:`physic_core.types.person_rows`.

    The others are those of :class:`physic_core.types.Reconstruction`.
    """

    files: Mapping[str, str]
    rows: tuple[Mapping[str, Any], ...]
    unposed: tuple[UnposedPerson, ...]
    checks: tuple[CheckResult, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    stages: tuple[StageRecord, ...]


def read_record(folder: Path) -> ResultRecord:
    """Read the document of a result.

    Raises:
        InputError: it is missing, damaged, edited, or of another version.
    """
    document = read_document(folder)
    try:
        record: ResultRecord = join(ResultRecord, document, {})
    except Exception as error:  # dataclasses raise many classes for invalid values
        raise damaged(folder, error) from error
    inside = paths_inside(folder, record.files)
    return replace(record, files={name: record.files[name] for name in inside})
