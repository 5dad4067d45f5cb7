"""Read depth maps and point maps of the user's from files, and bring them to the size of the photo.

Phones of Apple store disparity in 8 bits beside a HEIC photo, and its range in units of 1 / metre
("pixelShift / (pixelFocalLength * baselineInMeters)", Apple's page "Creating Auxiliary Depth Data
Manually"). Where two cameras measured it, the file calls it relative: its order is right, its size
is not promised.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError
from physic_core.files import (
    ImageSource,
    decode,
    open_image,
    open_regular,
    read_arrays,
    read_names,
    shorten,
    wrap_decoding_errors,
)
from physic_opencv.exr import MAX_BYTES, check_size, read_exr
from physic_opencv.jpeg_depth import read_jpeg_depth

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray

DEPTH_SUFFIXES = (".npy", ".npz", ".png", ".exr", ".pfm", ".heic", ".heif", ".hif", ".jpg", ".jpeg")
POINTMAP_SUFFIXES = (".npy", ".npz")
_UNIFORM_DISPARITY = 1
_LONGEST = 200  # characters of a text of the file in a message
_LISTED = 8  # arrays
_RELATIVE = re.compile(rb"depthData:Accuracy\W{1,4}relative")


def read_phone_depth(path: Path) -> tuple[FloatArray, bool]:
    """Return the depth (H, W) in metres, inf at infinity, and whether the file calls it relative.

    Raises:
        PackageMissingError: the package pi-heif is not installed.
        InputError: the file cannot be read, has no depth map, or one of another kind than disparity
            with its range.
    """
    source = ImageSource(
        str(path), path=path, role="depth map", formats="a HEIC photo of a phone that stores depth"
    )
    with open_image(source) as (image, file):
        images = image.info.get("depth_images")
        if not images:
            raise InputError(
                f"the photo {path} has no depth map: take one in portrait mode, or give the depth "
                f"in another file"
            )
        kind = images[0].info["metadata"]
        if (
            kind.get("representation_type") != _UNIFORM_DISPARITY
            or not {"d_min", "d_max"} <= kind.keys()
        ):
            raise InputError(
                f"the depth map in {path} is not disparity with its range (it says "
                f"{kind or 'nothing'}), so its meters "
                "are not known; convert it to .npy"
            )
        with wrap_decoding_errors(source):
            values = np.asarray(images[0].to_pillow())
            file.seek(0)
            is_relative = _RELATIVE.search(file.read()) is not None
    if values.ndim != 2 or values.dtype != np.uint8:
        raise InputError(
            f"the depth map in {path} must have one channel of 8 bits, got {values.shape} "
            f"{values.dtype}"
        )
    disparity = kind["d_min"] + (kind["d_max"] - kind["d_min"]) * values.astype(np.float64) / 255
    with np.errstate(divide="ignore"):
        return np.where(disparity > 0, 1 / disparity, np.inf), is_relative


_NOTHING = 1e9  # and more is what renderers write where a ray hits nothing
_LARGEST_HALF = 65504.0  # the same, as far as 16 bits can say it
_LEAST_MEDIAN = 1e-6  # of a depth in any unit
_FEWEST_STEPS = 20  # of a depth in whole numbers, up to the median
_GREY = ("L", "I", "F", "I;16", "I;16L", "I;16B")
_PATCH_PX = 14  # of DINOv2, on which depth networks are built
_ASPECT_TOLERANCE = 0.01  # of the aspect ratio: one pixel of rounding in a map 100 px high


def read_depth(
    path: Path, scale: float, invalid: float | None
) -> tuple[FloatArray, bool, tuple[str, ...]]:
    """Read a depth map (H, W) in metres, NaN where it is unknown, whether its file calls it
    relative, and notes.

    Args:
        path: a .npy array (H, W), an .npz with "depth" (H, W) or (1, H, W) and optionally "valid"
            (H, W) bool, a PNG of 16 bits with one channel, an .exr file, a PFM of one channel, or a
            HEIC or JPEG photo of a phone.
        scale: metres per unit of the file.
        invalid: value of unknown pixels besides 0, NaN, infinity, 1e9 and more, and the largest
            number of 16 bits (65535, or 65504 in floating point), in units of the file; None for no
            other.

    Raises:
        InputError: the file cannot be read, has another format or shape, or has no known pixel.
    """
    suffix = check_suffix(path, DEPTH_SUFFIXES)
    _require(path, "depth map")
    is_relative = False
    values: NDArray[np.generic]
    valid: NDArray[np.generic] | None = None
    notes: tuple[str, ...] = ()
    if suffix in POINTMAP_SUFFIXES:
        values, valid, notes = _load_arrays(path, "depth")
        if suffix == ".npz" and values.ndim == 3 and len(values) == 1:
            values = values[0]  # of a network that takes several pictures
            valid = None if valid is None else valid.reshape(valid.shape[-2:])
    elif suffix in (".png", ".pfm"):
        values = _read_picture(path)
        if values.dtype == np.uint8:
            raise InputError(
                f"the depth map {path} has 8 bits per pixel, whose unit is not known and whose "
                f"steps are too coarse: "
                "give a PNG of 16 bits in millimeters, or a .npy array in meters"
            )
    elif suffix == ".exr":
        values = read_exr(path)
    elif suffix in (".jpg", ".jpeg"):
        values, is_relative = read_jpeg_depth(path)
    else:
        values, is_relative = read_phone_depth(path)
    if values.ndim == 3 and values.shape[2] == 1:
        values = values[..., 0]
    if values.ndim != 2:
        raise InputError(
            f"the depth map {path} must be (H, W), one number per pixel, got {values.shape}"
        )
    if values.dtype.kind not in "fiu":
        raise InputError(f"the depth map {path} must hold numbers, got {values.dtype}")
    with np.errstate(invalid="ignore"):  # a signaling NaN
        depth = values.astype(np.float64)
    unknown = ~np.isfinite(depth) | (depth <= 0) | (depth >= _NOTHING)
    if values.dtype.kind == "f":
        unknown |= depth == _LARGEST_HALF
    elif values.dtype == np.uint16:
        unknown |= depth == np.iinfo(np.uint16).max
    if invalid is not None and math.isfinite(invalid):
        unknown |= depth == invalid
    if valid is not None:
        unknown |= ~_checked_valid(path, valid, depth.shape)
    if unknown.all():
        raise InputError(
            f"the depth map {path} has no known pixel: every value is 0, negative, NaN or the "
            f"invalid one"
        )
    _check_steps(path, depth[~unknown])
    return np.where(unknown, np.nan, depth * scale).astype(np.float32), is_relative, notes


def _check_steps(path: Path, depth: FloatArray) -> None:
    """Refuse known values (M,) that were rounded to few whole numbers, such as meters in 8 bits."""
    middle = float(np.median(depth))
    if not _LEAST_MEDIAN <= middle <= 1 / _LEAST_MEDIAN:
        raise InputError(
            f"the depth in {path} has a median of {middle:.3g}: are its bytes in another order?"
        )
    if depth.min() < depth.max() and middle < _FEWEST_STEPS and np.array_equal(depth, depth // 1):
        raise InputError(
            f"the depth in {path} has whole numbers alone, with a median of {middle:g}: steps of "
            f"{100 / middle:.0f}% are too coarse; store numbers with decimals, or a smaller unit"
        )


def read_pointmap(path: Path, scale: float) -> tuple[FloatArray, BoolArray, tuple[str, ...]]:
    """Read a point map: points (H, W, 3) times ``scale``, which pixels are valid (H, W), and notes.

    A point is invalid if a coordinate is NaN or infinite, or z is not positive.

    Args:
        path: a .npy array (H, W, 3), or an .npz with "points" (H, W, 3) and optionally "valid" (H,
            W) bool.
        scale: factor on the points.

    Raises:
        InputError: the file cannot be read, has another format or shape, or has no valid point.
    """
    check_suffix(path, POINTMAP_SUFFIXES)
    _require(path, "point map")
    points, valid, notes = _load_arrays(path, "points")
    if points.ndim != 3 or points.shape[2] != 3 or points.dtype.kind not in "fiu":
        raise InputError(
            f"the points of {path} must be (H, W, 3) numbers, got {points.shape} {points.dtype}"
        )
    points = points.astype(np.float64) * scale
    is_known = np.isfinite(points).all(-1) & (np.nan_to_num(points[..., 2]) > 0)
    if valid is not None:
        is_known &= _checked_valid(path, valid, points.shape[:2])
    if not is_known.any():
        raise InputError(
            f"the point map {path} has no valid point: every one is NaN, behind the camera or not "
            f"valid"
        )
    _check_steps(path, points[is_known][:, 2] / scale)
    return np.where(is_known[..., None], points, 0).astype(np.float32), is_known, notes


def _checked_valid(path: Path, valid: NDArray[np.generic], shape: tuple[int, ...]) -> BoolArray:
    if valid.shape != shape or valid.dtype != np.bool_:
        raise InputError(
            f'"valid" of {path} must be {shape} bool, one value per pixel, got {valid.shape} '
            f"{valid.dtype}"
        )
    return np.asarray(valid, np.bool_)


def resize_nearest(
    values: NDArray[np.generic], height: int, width: int, path: Path
) -> tuple[NDArray[np.generic], tuple[str, ...]]:
    """Resize a map (H, W, ...) to the size of the photo without mixing pixels, and return it with a
    note.

    Raises:
        InputError: the map has another aspect ratio than the photo, so that it shows another crop
            or photo.
    """
    rows, columns = values.shape[:2]
    if (rows, columns) == (height, width):
        return values, ()
    if (
        not _is_rounded(rows, columns, height, width)
        and abs(math.log((columns / rows) / (width / height))) > _ASPECT_TOLERANCE
    ):
        raise InputError(
            f"{path} has {columns} x {rows} px, which is not the aspect ratio of the photo "
            f"({width} x {height} px): give a map of the same photo, upright and not cropped"
        )
    y = np.minimum(((np.arange(height) + 0.5) * rows / height).astype(int), rows - 1)
    x = np.minimum(((np.arange(width) + 0.5) * columns / width).astype(int), columns - 1)
    note = (
        f"{path.name} was resized from {columns} x {rows} to {width} x {height} px, each pixel "
        f"from the nearest one"
    )
    return np.ascontiguousarray(values[y][:, x]), (note,)


def _is_rounded(rows: int, columns: int, height: int, width: int) -> bool:
    """Return whether a map has the photo's sides at one scale, rounded to the patches of a
    network.
    """
    if rows % _PATCH_PX or columns % _PATCH_PX:
        return False
    scale = math.sqrt(columns * rows / (width * height))
    return max(abs(columns - scale * width), abs(rows - scale * height)) <= _PATCH_PX / 2


def check_suffix(path: Path, suffixes: tuple[str, ...]) -> str:
    """Return the suffix of a file in small letters.

    Raises:
        InputError: it is none of the known ones.
    """
    suffix = path.suffix.lower()
    if suffix not in suffixes:
        raise InputError(
            f"cannot read {path}: its name ends in none of {', '.join(suffixes)}; convert it"
        )
    return suffix


def _require(path: Path, what: str) -> None:
    if not path.is_file():
        raise InputError(f"cannot read the {what} {path}: there is no such file; check the path")


def _load_npy(path: Path) -> NDArray[np.generic]:
    try:
        # refuses a shape that is larger than the file
        values = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # damaged headers lead to many classes
        raise InputError(
            f"cannot read {path}: it is not a NumPy array of numbers "
            f"({shorten(str(error), _LONGEST)})"
        ) from error
    if not isinstance(values, np.ndarray):
        raise InputError(
            f"cannot read {path}: it is an archive of arrays; save one array with numpy.save"
        )
    check_size(path, values.nbytes)  # a sparse file can be larger than the disk
    return values


def _load_arrays(
    path: Path, needed: str
) -> tuple[NDArray[np.generic], NDArray[np.generic] | None, tuple[str, ...]]:
    """Read a .npy file, or an array of a .npz and "valid", None if it is missing, with a note on
    the other arrays.
    """
    if path.suffix.lower() == ".npy":
        return _load_npy(path), None, ()
    try:
        with open_regular(path) as stream:
            names = read_names(stream)
            if needed not in names:
                raise InputError(
                    f'cannot read {path}: it has no array "{needed}"; it has '
                    f"{shorten(', '.join(names), _LONGEST) or 'none'}"
                )
            wanted = [name for name in (needed, "valid") if name in names]
            arrays = read_arrays(stream, wanted, limit=MAX_BYTES)
    except InputError:
        raise
    except Exception as error:  # of NumPy, zipfile and its decompressors, which share no base class
        raise InputError(
            f"cannot read {path}: it is not an archive of NumPy arrays "
            f"({shorten(str(error), _LONGEST)})"
        ) from error
    others = [shorten(name, _LONGEST) for name in names if name not in wanted]
    note = f"{path.name}: {', '.join(wanted)} is used, {', '.join(others[:_LISTED])} is not"
    return arrays[needed], arrays.get("valid"), (note,) if others else ()


def _read_picture(path: Path) -> NDArray[np.generic]:
    source = ImageSource(
        str(path), path=path, role="depth map", formats="a PNG of 16 bits or PFM of one channel"
    )
    with open_image(source) as (image, _):
        decode(image, source)
        # of a PFM: some programs multiply by it, some divide, and most ignore it
        if (factor := image.info.get("scale", 1.0)) != 1:
            raise InputError(
                f"cannot read the {source}: its header states a scale of {factor:g}, which tools "
                f"read differently; write 1 or -1, with the depth in meters"
            )
        return np.asarray(image if image.mode in _GREY else image.convert("RGB"))
