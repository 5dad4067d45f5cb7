"""Cut a border of one colour round a photo, and give its result in px of the whole photo.

Such borders are the bars of a screenshot, the strips of a square picture and painted frames.
Networks take them for a part of the scene. A plain background of a studio is no border: its edge is
not straight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.io.photo import MIN_SIDE, limit_size
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.io.photo import Photo
    from physic_core.types import FloatArray, Intrinsics, Reconstruction, UInt8Array

    Inside = tuple[slice, slice]

MOST_SAMPLES = 500
"""Pixels of a row that are compared, whatever the size of the photo."""
_PLAIN = 8  # largest variation of a border, grey levels; a sky over a horizon varies more
_PLAIN_THIN = 48  # the same of a thin frame, which JPEG mixes with the photo
_THIN_PX = 3
_STRAY = 0.002  # share of other pixels in a border
# Share of columns with other pixels in the photo's first rows: a head on a plain ground spans less.
_EDGE = 0.8
# Parts of one row may have the colour of the border, as bright sand has that of a white one.
_FIRST_PX = 16
_ROWS = 64  # that are compared at a time: most photos end in the first of them
_RINGING_PX = 16  # JPEG changes a border in the blocks that it shares with the photo
_LEAST_BAR = 0.01  # of the side; a narrower bar on one side does not disturb networks
# Of the area: the whole result has at most ten times the pixels of the picture inside.
_LEAST_INSIDE = 0.1
_THINNEST = 0.1  # ratio of the sides of a picture inside


def find_border(image: UInt8Array) -> Inside | None:
    """Return rows and columns of the picture inside the borders of an image (H, W, 3); None without
    a border.
    """
    height, width = image.shape[:2]
    wide = _inside_of_border(image, _LEAST_BAR)
    thin = _inside_of_border(image, 0.0)
    framed = all(
        part.start > 0 and part.stop < whole
        for part, whole in zip(thin, (height, width), strict=True)
    )
    inside = thin if framed else wide
    sides = [part.stop - part.start for part in inside]
    if (
        min(sides) < max(MIN_SIDE, _THINNEST * max(sides))
        or math.prod(sides) < _LEAST_INSIDE * height * width
    ):
        return None
    return None if sides == [height, width] else inside


def _inside_of_border(image: UInt8Array, least: float) -> Inside:
    """Return rows and columns between bars whose width is at least a share of the side."""
    inside = slice(0, image.shape[0]), slice(0, image.shape[1])
    for _ in range(2):  # the upper bar of a frame is found again without its sides
        rows, columns = inside
        start, stop = _rows_between_bars(image[inside], least)
        rows = slice(rows.start + start, rows.start + stop)
        start, stop = _rows_between_bars(image[rows, columns].transpose(1, 0, 2), least)
        inside = rows, slice(columns.start + start, columns.start + stop)
    return inside


def _rows_between_bars(rows: UInt8Array, least: float) -> tuple[int, int]:
    return _bar_width(rows, least), len(rows) - _bar_width(rows[::-1], least)


def _bar_width(rows: UInt8Array, least: float) -> int:
    """Return the number of rows (R, C, 3) of one colour before the straight edge of a picture; 0
    without a bar.
    """
    samples = rows[:, :: max(1, rows.shape[1] // MOST_SAMPLES)]
    outermost = samples[: max(1, math.ceil(least * len(rows)))].astype(np.int16)
    color = np.median(outermost[0], axis=0)
    tolerance = np.abs(outermost - color).max() + 1
    if tolerance > (_PLAIN if least else _PLAIN_THIN):  # most photos
        return 0
    stop = _first_other_row(samples, color, tolerance)
    if stop < len(outermost):
        return 0
    after = samples[stop - 1 : stop + _RINGING_PX + _FIRST_PX].astype(np.int16)
    steps = np.abs(np.diff(after[: _RINGING_PX + 2], axis=0)).mean((1, 2))
    further = int((steps >= steps.max() / 2).argmax())
    first = after[1 + further :][:_FIRST_PX]
    other = (largest_channel(np.abs(first - color)) > 2 * tolerance).any(0)
    edge = stop + further
    return edge if other.mean() >= _EDGE and (least or edge <= _THIN_PX) else 0


def largest_channel(values: NDArray[Any]) -> NDArray[Any]:
    """Return the largest (...) of three channels (..., 3), six times as fast as ``max(-1)``."""
    first, second, third = np.moveaxis(values, -1, 0)
    return np.asarray(np.maximum(np.maximum(first, second), third))


def _first_other_row(samples: UInt8Array, color: FloatArray, tolerance: float) -> int:
    """Return the first of rows (R, C, 3) with pixels of another colour; 0 if there is none."""
    for start in range(0, len(samples), _ROWS):
        difference = np.abs(samples[start : start + _ROWS].astype(np.int16) - color)
        other = (largest_channel(difference) > tolerance).mean(1) > _STRAY
        if other.any():
            return start + int(other.argmax())
    return 0


def cut_camera(camera: Intrinsics, size: tuple[int, int], inside: Inside) -> Intrinsics:
    """Return the camera of the picture inside; a principal point in the centre of the photo moves
    to its centre.

    Args:
        camera: of the whole photo.
        size: height and width of the whole photo, px.
        inside: rows and columns.
    """
    rows, columns = inside
    width, height = (side - whole + part.stop - part.start for side, whole, part in (
        (camera.width, size[1], columns), (camera.height, size[0], rows),
    ))  # fmt: skip
    if (camera.cx, camera.cy) == ((camera.width - 1) / 2, (camera.height - 1) / 2):
        return replace(camera, cx=(width - 1) / 2, cy=(height - 1) / 2, width=width, height=height)
    return replace(
        camera, cx=camera.cx - columns.start, cy=camera.cy - rows.start, width=width, height=height
    )


def limit_inside(photo: Photo, inside: Inside, max_side: int) -> tuple[Photo, Inside]:
    """Resize a photo so that the picture inside has at most ``max_side`` px; return it with its
    rows and columns.
    """
    height, width = photo.image.shape[:2]
    longest = max(part.stop - part.start for part in inside)
    photo = limit_size(photo, max_side * max(height, width) // longest)
    scales = photo.image.shape[0] / height, photo.image.shape[1] / width
    rows, columns = (
        slice(math.ceil(part.start * scale), math.floor(part.stop * scale))
        for part, scale in zip(inside, scales, strict=True)
    )
    return photo, (rows, columns)


def cut_border(photo: Photo, inside: Inside, what: str) -> Photo:
    """Return the picture inside a photo, with its camera, and a note of what was cut off."""
    height, width = photo.image.shape[:2]
    image = np.ascontiguousarray(photo.image[inside])
    note = (
        f"{what} was cropped for the computation, leaving {image.shape[1]} x "
        f"{image.shape[0]} px. Pixels of the results are those of the whole photo"
    )
    camera = (
        None if photo.intrinsics is None else cut_camera(photo.intrinsics, (height, width), inside)
    )
    return replace(photo, image=image, intrinsics=camera, notes=(*photo.notes, note))


@dataclass(frozen=True)
class Border(ShortRepr):
    """The whole photo around the picture that was reconstructed.

    Attributes:
        image: (H, W, 3) uint8 RGB, at the size of the result.
        inside: rows and columns of the picture.
    """

    image: UInt8Array
    inside: Inside

    def added_to(self, result: Reconstruction) -> Reconstruction:
        """Return a result in px of the whole photo; the border has no valid points."""
        scene = result.scene
        camera = result.intrinsics
        rows, columns = self.inside
        shift = np.array([columns.start, rows.start] * 2, np.float32)

        def padded(values: Any, fill: float) -> Any:
            whole = np.full((*self.image.shape[:2], *values.shape[2:]), fill, values.dtype)
            whole[self.inside] = values
            return whole

        colors = self.image.copy()
        colors[self.inside] = scene.colors
        people = [
            replace(
                one,
                box=one.box + shift if one.mask.any() else one.box,
                mask=padded(one.mask, False),
                keypoints=one.keypoints + shift[:2],
            )
            for one in result.people
        ]
        unposed = [
            replace(one, box=tuple((np.array(one.box) + shift).tolist())) for one in result.unposed
        ]
        size = {"width": self.image.shape[1], "height": self.image.shape[0]}
        return replace(
            result,
            image=self.image,
            intrinsics=replace(
                camera, cx=camera.cx + columns.start, cy=camera.cy + rows.start, **size
            ),
            scene=replace(
                scene,
                points=padded(scene.points, 0),
                normals=padded(scene.normals, 0),
                colors=colors,
                valid=padded(scene.valid, False),
            ),
            people=tuple(people),
            unposed=tuple(unposed),
        )
