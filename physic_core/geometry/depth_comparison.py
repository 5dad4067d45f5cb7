"""Compare what a file says of a photo with what a network sees in it, under other readings of the
file: turned, mirrored, moved, or of another quantity than depth along the optical axis.

A network knows the inverse depth of a photo up to a factor and a shift. The error of a reading is
the share of it that the best line through the file's inverse depth leaves unexplained: 0 if they
agree, 1 if the file says nothing. The file was not made from the network's answer, so that both
agree only if the file is read as it was written. OpenCV camera frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Intrinsics, Pointmap

_SIDE = 96  # of the compared maps, px
_FEWEST = 0.1  # share of the pixels that both know
SURELY = 0.6
"""Error of another reading over that of the stated one, up to which the file is refused.

Other readings of correct files have 0.85 and more; those that are right 0.08 to 0.31 for turned
files, 0.48 to 0.56 for distances along the ray.
"""
LIKELY = 0.75
"""The same, up to which it is doubtful."""

_FITS = 0.35  # largest error of a reading that explains a file
_AGREES = 0.06  # error below which no other reading is looked for
STRANGER = 0.35
"""Error from which on a file may be of another photo."""

_TWO_CHANGES = 1.25  # on the error of a reading that differs in two ways
_LEAST = 1e-9
_BUFFER = 0.8  # least value of a depth buffer; a room with people is farther than 1 m

_Turn = Callable[[Any], Any]

TURNS: dict[str, tuple[_Turn, str]] = {
    "": (lambda a: a, ""),
    "mirrored": (lambda a: a[..., ::-1], "exchange left and right"),
    "upside down": (lambda a: a[..., ::-1, :], "exchange top and bottom"),
    "turned by 180 degrees": (lambda a: a[..., ::-1, ::-1], "turn it"),
    "turned by 90 degrees": (lambda a: a.swapaxes(-1, -2)[..., ::-1], "turn it back"),
    "turned by -90 degrees": (lambda a: a.swapaxes(-1, -2)[..., ::-1, :], "turn it back"),
    "transposed": (lambda a: a.swapaxes(-1, -2), "exchange rows and columns"),
    "turned and mirrored": (
        lambda a: a.swapaxes(-1, -2)[..., ::-1, ::-1],
        "exchange rows and columns, and turn it by 180 degrees",
    ),
}
"""What a file is -> how the photo's pixels are found in an array (..., H, W), and the cure."""

_QUANTITIES: dict[str, tuple[Callable[[Any, Any], Any], str]] = {
    "": (lambda d, ray: 1 / d, ""),
    "the distance along the ray": (
        lambda d, ray: ray / d,
        "divide it by sqrt(1 + ((x - cx) / fx)^2 + ((y - cy) / fy)^2), for meters along the "
        "optical axis",
    ),
    "a disparity, or inverse depth": (
        lambda d, ray: d,
        "give meters along the optical axis: focal length in px x distance of the two cameras in "
        "m / disparity in px",
    ),
    "a renderer's depth buffer": (
        lambda d, ray: -d,
        "give meters along the optical axis: near x far / (far - value x (far - near))",
    ),
    "the logarithm of depth": (
        lambda d, ray: np.exp(-np.clip(d, -50, 50)),
        "give meters along the optical axis",
    ),
}
"""What a file holds -> its inverse depth, up to a factor and a shift, and the cure."""

_FIELDS = (0.7, 0.8, 0.9, 1.0, 1.11, 1.25, 1.43)  # of view, over the photo's
_SHAPES = (9 / 16, 3 / 4, 4 / 3, 16 / 9)  # of a canvas that was resized, over the photo's
_FARTHEST_MOVE = 12  # of masks, px of the compared size
_OFFSETS = tuple(np.arange(-4, 5) * 0.03)  # of the long side


class Comparison(NamedTuple):
    """What a depth map seems to be.

    Attributes:
        error: of the map as it is stated, 0 to 1.
        best_error: of the best other reading, if that explains the photo; otherwise ``error``.
        best_reading: that reading, such as "mirrored".
        advice: what to do about it.
    """

    error: float
    best_error: float
    best_reading: str = ""
    advice: str = ""

    @property
    def ratio(self) -> float:
        """Error of the other reading over that of the stated one."""
        return self.best_error / max(self.error, _LEAST)

    def __str__(self) -> str:
        return (
            f"it fits the photo better as {self.best_reading} ({self.error:.0%} of what a network "
            f"sees is left unexplained, and {self.best_error:.0%} then): {self.advice}"
        )


def compare_depth(
    depth: FloatArray, references: Sequence[Pointmap], camera: Intrinsics
) -> Comparison:
    """Compare a depth map with what a network sees.

    Args:
        depth: (H, W) along the optical axis, in any unit, NaN where unknown.
        references: of the same photo, with its people and without; the depth may show either.
        camera: of the photo.
    """
    small = _downsampled(depth)
    maps = [_inverse_depth(one) for one in references]
    ray = _downsampled(_ray_lengths(camera))
    as_stated = _error(_inverse_depth_of_reading(small, ray, ""), maps)
    if as_stated <= _AGREES and not _is_depth_buffer(small):
        return Comparison(as_stated, as_stated)
    best = min(
        (
            *_other_readings(small, ray, maps),
            *_moved_readings(small, maps),
            *_padded_readings(small, maps),
        ),
        key=lambda one: one[0],
    )
    return Comparison(as_stated, *best) if best[0] <= _FITS else Comparison(as_stated, as_stated)


def _other_readings(
    depth: FloatArray, ray: FloatArray, maps: Sequence[FloatArray]
) -> Iterator[tuple[float, str, str]]:
    """Yield the error of each reading of another orientation or quantity, its name, and the
    cure.
    """
    for turn, quantity in product(TURNS, _QUANTITIES):
        turned = TURNS[turn][0](depth)
        if not (turn or quantity) or turned.shape != depth.shape:
            continue
        error = _error(_inverse_depth_of_reading(turned, ray, quantity), maps)
        if quantity == "a renderer's depth buffer" and _is_depth_buffer(depth):
            error *= SURELY / 1.1  # a buffer of a narrow range is a line through inverse depth, too
        if turn and quantity:
            error *= _TWO_CHANGES
        names = filter(None, (turn, quantity))
        cures = filter(None, (TURNS[turn][1], _QUANTITIES[quantity][1]))
        yield error, ", and ".join(names), "; ".join(cures)


def _is_depth_buffer(depth: FloatArray) -> bool:
    """Return whether all values are just below 1, as those of a renderer's depth buffer."""
    values_known = depth[np.isfinite(depth)]
    return bool(values_known.size and values_known.min() >= _BUFFER and values_known.max() <= 1)


def _moved_readings(
    depth: FloatArray, maps: Sequence[FloatArray]
) -> Iterator[tuple[float, str, str]]:
    """Yield the error, name and cure of the best other offset and field of view."""
    few = [one[::2, ::2] for one in maps]
    best = max(
        product(_FIELDS, _OFFSETS, _OFFSETS),
        key=lambda one: max(
            _correlation(_inverse_depth_of_reading(_reprojected(depth[::2, ::2], *one)), m)
            for m in few
        ),
    )
    if best == (1.0, 0.0, 0.0):
        return
    field, right, down = best
    moved = _reprojected(depth, *best)
    overlap_depth = np.where(np.isfinite(moved), depth, np.nan)  # others explain other pixels
    as_stated = _error(_inverse_depth_of_reading(overlap_depth), maps)
    yield (
        _error(_inverse_depth_of_reading(moved), maps)
        * _error(_inverse_depth_of_reading(depth), maps)
        / max(as_stated, _LEAST),
        f"of a field of view of {1 / field:.0%} of the photo's, moved by {right:+.0%} to the right "
        f"and {down:+.0%} down",
        "give a depth map that is registered to the photo, pixel by pixel",
    )


def _padded_readings(
    depth: FloatArray, maps: Sequence[FloatArray]
) -> Iterator[tuple[float, str, str]]:
    """Yield the error, name and cure of each map that was resized with bars beside the picture."""
    height, width = depth.shape
    for shape in _SHAPES:
        rows = round(height * min(1, shape))
        columns = round(width * min(1, 1 / shape))
        top, left = (height - rows) // 2, (width - columns) // 2
        picture = depth[top : top + rows, left : left + columns]
        y = (np.arange(height) + 0.5) / height * rows
        x = (np.arange(width) + 0.5) / width * columns
        error = _error(_inverse_depth_of_reading(picture[y.astype(int)][:, x.astype(int)]), maps)
        yield (
            _TWO_CHANGES * error,
            f"of a picture with bars {'at the top and bottom' if shape < 1 else 'at the sides'}",
            "cut the bars off, and resize the rest to the photo",
        )


def _reprojected(values: FloatArray, field: float, right: float, down: float) -> FloatArray:
    """Return an array (h, w) as another camera sees it, NaN outside."""
    height, width = values.shape
    side = max(height, width)
    x, y = (
        np.rint((np.arange(n) - (n - 1) / 2) * field + (n - 1) / 2 + offset * side).astype(int)
        for n, offset in ((width, right), (height, down))
    )
    inside = ((y >= 0) & (y < height))[:, None] & ((x >= 0) & (x < width))
    values_there = values[y.clip(0, height - 1)][:, x.clip(0, width - 1)]
    return np.where(inside, values_there, np.nan)


def _inverse_depth_of_reading(
    depth: FloatArray, ray: FloatArray | float = 1.0, quantity: str = ""
) -> FloatArray:
    """Return the inverse depth (h, w) of a reading, up to a factor and a shift."""
    with np.errstate(all="ignore"):
        near: FloatArray = np.asarray(_QUANTITIES[quantity][0](depth, ray), np.float64)
    return near


def _error(near: FloatArray, maps: Sequence[FloatArray]) -> float:
    return min(_unexplained_share(near, one) for one in maps)


def _common_values(near: FloatArray, reference: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Return the values (n,) of both maps where they are known, without outliers of the first; None
    for too few.
    """
    is_known = np.isfinite(near) & np.isfinite(reference)
    if is_known.mean() < _FEWEST:
        return None
    x = near[is_known]
    low, high = np.percentile(x, [1, 99])
    return np.clip(x, low, high), reference[is_known]


def _unexplained_share(near: FloatArray, reference: FloatArray) -> float:
    """Return the mean distance of a map (h, w) from a rising line through another one, over that
    from its median.
    """
    common = _common_values(near, reference)
    if common is None or np.ptp(common[0]) <= 0:
        return 1.0
    x, y = common
    usual = max(float(np.abs(y - np.median(y)).mean()), 1e-12)
    weight = np.ones_like(y)
    for _ in range(6):  # of least absolute distances
        mx, my = np.average(x, weights=weight), np.average(y, weights=weight)
        slope = (weight * (x - mx) * (y - my)).sum() / (weight * (x - mx) ** 2).sum()
        away = np.abs(y - my - slope * (x - mx))
        weight = 1 / np.maximum(away, 0.02 * usual)
    return min(1.0, float(away.mean()) / usual) if slope > 0 else 1.0


def _correlation(near: FloatArray, reference: FloatArray) -> float:
    common = _common_values(near, reference)
    if common is None or min(map(np.ptp, common)) <= 0:
        return -1.0
    return float(np.corrcoef(*common)[0, 1])


def _inverse_depth(pointmap: Pointmap) -> FloatArray:
    """Return the inverse depth (h, w) of a network, NaN where it is not valid."""
    z = pointmap.points[..., 2]
    with np.errstate(divide="ignore"):
        inverse = np.where(pointmap.valid & (z > 0), 1 / z.astype(np.float64), np.nan)
    small: FloatArray = _downsampled(inverse)
    return small


def _ray_lengths(camera: Intrinsics) -> FloatArray:
    """Return the length (H, W) of each pixel's ray up to z = 1."""
    x = (np.arange(camera.width) - camera.cx) / camera.fx
    y = (np.arange(camera.height) - camera.cy) / camera.fy
    return np.sqrt(1 + x**2 + y[:, None] ** 2)


def _downsampled(values: Any) -> Any:
    """Return an array (H, W) at :data:`_SIDE` px of the long side, by its nearest pixels."""
    height, width = values.shape
    share = min(1.0, _SIDE / max(height, width))
    rows, columns = (
        ((np.arange(max(1, round(n * share))) + 0.5) / max(1, round(n * share)) * n).astype(int)
        for n in (height, width)
    )
    return values[rows][:, columns]


def turned_masks(given_masks: BoolArray, detected_masks: BoolArray) -> str:
    """Return what masks or outlines of people seem to be, and the cure, such as "mirrored: exchange
    left and right"; "" if they are best as they are, or nothing is clearly better.

    Masks are moved only if hardly half of them fits where they are, since those of other networks,
    and outlines of bodies, are wider or narrower.

    Args:
        given_masks: (M, H, W), by a file; each of a person or of all.
        detected_masks: (N, H, W), of the people that are detected.
    """
    if not len(given_masks) or not len(detected_masks):
        return ""
    both = [*detected_masks, detected_masks.any(0)]
    small, people = (
        np.stack([_downsampled(mask) for mask in masks]) for masks in (given_masks, both)
    )
    readings = {turn: (turned(small), advice) for turn, (turned, advice) in TURNS.items()}
    readings["inverted"] = ~small, "exchange people and background"
    apart = {
        reading: 1 - float(mask_iou(masks, people).max(1).mean())
        for reading, (masks, _) in readings.items()
        if masks.shape == small.shape
    }
    best = min(apart, key=apart.__getitem__)
    if best and apart[best] <= min(0.5, SURELY * apart[""]):
        return f"{best}: {readings[best][1]}"
    if apart[""] < 0.5:
        return ""
    steps = np.arange(-_FARTHEST_MOVE, _FARTHEST_MOVE + 1) / _SIDE
    moves = list(product(steps, steps))
    errors = [1 - float(mask_iou(_moved_masks(small, *one), people).max(1).mean()) for one in moves]
    (right, down), error = min(zip(moves, errors, strict=True), key=lambda pair: pair[1])
    if error > 0.5 * apart[""]:
        return ""
    return (
        f"moved by {right:+.0%} to the right and {down:+.0%} down: give those of this photo, "
        f"pixel by pixel"
    )


def _moved_masks(masks: BoolArray, right: float, down: float) -> BoolArray:
    """Return masks (M, h, w) as :func:`_reprojected` moves them."""
    return np.stack([_reprojected(mask * 1.0, 1.0, right, down) > 0 for mask in masks])


def mask_iou(masks: BoolArray, others: BoolArray) -> FloatArray:
    """Return the intersections over unions (M, N) of masks (M, H, W) and (N, H, W) bool; 0 for
    two empty masks.
    """
    both = np.tensordot(masks.astype(np.float64), others.astype(np.float64), ([1, 2], [1, 2]))
    areas = masks.sum((1, 2))[:, None] + others.sum((1, 2))
    iou: FloatArray = both / np.maximum(areas - both, 1)
    return iou
