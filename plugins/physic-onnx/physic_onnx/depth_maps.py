"""Check and convert depth maps in network outputs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import BackendError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import FloatArray, Hints, Intrinsics

_MOST_SQUASH = 1.6
_LEAST_SPREAD = 1e-6  # of the largest value; below it a map is a constant


def squeeze_map(values: NDArray[Any], what: str, file: str, *, may_be_flat: bool = False) -> FloatArray:
    """Return the single map (h, w) float32 of an output with batch, view or channel axes of size 1.

    Args:
        values: as the network gave it.
        what: name of the output.
        file: name of the network.
        may_be_flat: whether one and the same number everywhere is an answer.

    Raises:
        BackendError: it holds no map or several, no number, or one and the same number everywhere.
    """

    shape = values.shape
    while values.ndim > 2 and 1 in values.shape:
        values = np.squeeze(values, axis=values.shape.index(1))
    if values.ndim != 2:
        raise BackendError(f"{file} returned {what} of shape {shape}: one map (height, width) was expected")
    found = np.asarray(values, np.float32)
    finite = found[np.isfinite(found)]
    if not finite.size:
        raise BackendError(
            f"{file} returned {what} without one finite number: in half precision networks can overflow; "
            "use its float32 file"
        )
    if not may_be_flat and found.size > 1 and np.ptp(finite) <= _LEAST_SPREAD * np.abs(finite).max():
        raise BackendError(
            f"{file} returned {what} = {float(finite[0]):.4g} for every pixel: some exports in half precision do so on "
            "GPUs; use its float32 file, or provider 'cpu'"
        )
    return found


def fixed_input_size(shape: tuple[int | str, ...]) -> tuple[int | None, int | None]:
    """Return height and width of a network input; None for a side that is not fixed."""
    rows, columns = (side if isinstance(side, int) else None for side in shape[-2:])
    return rows, columns


def aspect_change_note(image: NDArray[Any], rows: int, columns: int, file: str) -> tuple[str, ...]:
    """Return a note if a fixed input size changes the photo's aspect by more than a factor of 1.6, else nothing."""
    height, width = image.shape[:2]
    squash = (columns / rows) / (width / height)
    if 1 / _MOST_SQUASH < squash < _MOST_SQUASH:
        return ()
    by = max(squash, 1 / squash)
    return (
        f"{file} sees {columns} x {rows} px only, so that the photo is squashed by a factor {by:.2g}; "
        "a file of free size would see it as it is",
    )


def required_camera(hints: Hints, image: NDArray[Any], name: str) -> Intrinsics:
    """Return the camera for an image from ``hints``, or raise BackendError.

    Raises:
        BackendError: none is known, and the network called ``name`` gives no metres without.
    """
    from physic_core.adapters.canonical_depth import known_camera

    camera = known_camera(hints, image)
    if camera is None:
        raise BackendError(
            f"{name} gives metres only for a known focal length, and none is known: set focal_px in [photo], "
            "or choose a relative_pointmap that finds the camera"
        )
    return camera


def mask_depth(depth: FloatArray, farthest: float | None) -> FloatArray:
    """Replace depth (h, w) that is not positive, or farther than ``farthest``, by NaN."""

    with np.errstate(invalid="ignore"):
        known = np.isfinite(depth) & (depth > 0)
        if farthest is not None:
            known &= depth <= farthest
    found: FloatArray = np.where(known, depth, np.nan).astype(np.float32)
    if not known.any():
        limit = "" if farthest is None else f" nearer than {farthest:g} m"
        raise BackendError(f"the network sees nothing in this photo{limit}: no pixel has a depth")
    return found
