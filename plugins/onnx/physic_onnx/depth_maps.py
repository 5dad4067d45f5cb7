"""Depth networks: input sizes in whole patches, checks of depth maps, and disparity to points.

Disparity is inverse depth up to scale and shift. Networks are trained with 0 for infinity, and
return it for the sky.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import BackendError
from physic_networks.pictures import resize_map

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray, Intrinsics


_PATCH = 14  # px


def input_size_least_scaling(height: int, width: int, side: int) -> tuple[int, int]:
    """Return the input size of DPT and Depth Anything: ``side`` px for the image side that needs
    less scaling.

    For a photo larger than ``side``, this is the short side; for a smaller one, the long side.

    Args:
        height: of the photo, px.
        width: of the photo, px.
        side: px, a multiple of a patch.

    Returns:
        Rows and columns, px, each the nearest multiple of ``patch`` and at least one patch.
    """
    tall = side / height
    wide = side / width
    scale = wide if abs(1 - wide) < abs(1 - tall) else tall
    return _nearest_multiple(scale * height), _nearest_multiple(scale * width)


def input_size_by_long_side(height: int, width: int, side: int) -> tuple[int, int]:
    """Return the input size of Depth Anything 3: long side ``side`` px, both sides rounded to
    whole patches.

    Args:
        height: of the photo, px.
        width: of the photo, px.
        side: px.
    """
    scale = side / max(height, width)
    rows = max(1, round(height * scale))
    columns = max(1, round(width * scale))
    return _nearest_multiple_or_up(rows), _nearest_multiple_or_up(columns)


def limit_patches(rows: int, columns: int, most: int) -> tuple[int, int]:
    """Reduce an input size to at most ``most`` patches, keeping about the same aspect.

    Time and memory of a transformer grow with the square of the number of patches.
    """
    patches = (rows // _PATCH) * (columns // _PATCH)
    if patches <= most:
        return rows, columns
    scale = math.sqrt(most / patches)
    fewer = (max(1, int(side * scale) // _PATCH) for side in (rows, columns))
    rows, columns = (_PATCH * count for count in fewer)
    return rows, columns


def _nearest_multiple(value: float) -> int:
    """Round to the nearest multiple of the patch size, at least one patch."""
    return max(1, round(value / _PATCH)) * _PATCH


def _nearest_multiple_or_up(value: int) -> int:
    """Round to the nearest multiple of the patch size, ties up, at least one patch."""
    return max(1, (2 * value + _PATCH) // (2 * _PATCH)) * _PATCH


_LEAST_SPREAD = 1e-6  # of the largest value; below it a map is a constant


def squeeze_map(
    values: NDArray[Any], what: str, file: str, *, may_be_flat: bool = False
) -> FloatArray:
    """Return the single map (h, w) float32 of an output with batch, view or channel axes of size 1.

    Args:
        values: as the network gave it.
        what: name of the output.
        file: name of the network.
        may_be_flat: whether a constant map is valid.

    Raises:
        BackendError: it holds no map or several, or a constant map.
    """

    shape = values.shape
    while values.ndim > 2 and 1 in values.shape:
        values = np.squeeze(values, axis=values.shape.index(1))
    if values.ndim != 2:
        raise BackendError(
            f"{file} returned {what} of shape {shape}: one map (height, width) was expected"
        )
    found = np.asarray(values, np.float32)
    finite = found[np.isfinite(found)]
    if (
        not may_be_flat
        and finite.size > 1
        and np.ptp(finite) <= _LEAST_SPREAD * np.abs(finite).max()
    ):
        raise BackendError(
            f"{file} returned {what} = {float(finite[0]):.4g} for every pixel: some exports in "
            "half precision do so on GPUs; use its float32 file, or provider 'cpu'"
        )
    return found


_MOST_SQUASH = 1.6


def aspect_change_note(image: NDArray[Any], rows: int, columns: int, file: str) -> tuple[str, ...]:
    """Return a note if a fixed input size changes the photo's aspect by more than a factor of 1.6,
    else nothing.
    """
    height, width = image.shape[:2]
    squash = (columns / rows) / (width / height)
    if 1 / _MOST_SQUASH < squash < _MOST_SQUASH:
        return ()
    by = max(squash, 1 / squash)
    return (
        f"{file} sees {columns} x {rows} px only, so that the photo is squashed by a factor "
        f"{by:.2g}; a file of free size would see it as it is",
    )


_LEAST_GAP = 0.002  # ranges of the disparity to the farthest point: depth stays finite
_SKY = 0.004  # ranges of the disparity


def clip_disparity(disparity: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Clip disparity (h, w) to a small positive minimum, and return a mask (h, w) of sky and NaN
    pixels.
    """
    low, high = np.percentile(disparity, [1, 99])
    span = max(float(high - low), 1e-6)
    lost: BoolArray = np.asarray(~(disparity >= _SKY * span))
    gap: FloatArray = np.maximum(np.where(lost, 0.0, disparity), _LEAST_GAP * span)
    return gap, lost


def points_from_disparity(
    gap: FloatArray, lost: BoolArray, camera: Intrinsics
) -> tuple[FloatArray, BoolArray]:
    """Compute points on the rays of a camera with z = 1 / disparity, in units of the median
    distance.

    Args:
        gap: (h, w) positive inverse depth, at any resolution.
        lost: (h, w) bool, pixels without a value; not all.
        camera: of the photo.

    Returns:
        (H, W, 3) float32 points, and (H, W) bool, which are valid.
    """
    # Resample the inverse depth: it may be averaged between a near and a far surface.
    z = 1 / resize_map(gap / np.median(gap[~lost]), camera.height, camera.width)
    valid = resize_map(lost, camera.height, camera.width) < 0.5
    u = ((np.arange(camera.width) - camera.cx) / camera.fx).astype(np.float32)
    v = ((np.arange(camera.height) - camera.cy) / camera.fy).astype(np.float32)
    return np.stack([z * u[None], z * v[:, None], z], axis=-1).astype(np.float32), valid
