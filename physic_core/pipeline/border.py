"""Cut a border of one colour round a photo, and give its result in px of the whole photo.

Such borders are the bars of a screenshot, the strips of a square picture and painted frames. Networks take them for a
part of the scene. A plain background of a studio is no border: its edge is not straight.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from physic_core.io.photo import MIN_SIDE
from physic_core.types import KnownSizes, PeoplePrompt
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.io.photo import Photo
    from physic_core.types import Intrinsics, Reconstruction, UInt8Array

    Inside = tuple[slice, slice]

_MOST_SAMPLES = 500  # of a row, whatever the size of the photo
_PLAIN = 8  # levels by which the pixels of a border differ from its colour; the sky over a horizon varies by more
_STRAY = 0.002  # share of other pixels in a border
_LEVELS = 12  # by which those of the photo differ
_EDGE = 0.8  # share of these in the first row of the photo: a head or a hat on a plain background spans less
_RINGING_PX = 16  # JPEG changes a border in the blocks that it shares with the photo
_LEAST_BAR = 0.01  # of the side: less disturbs no network
_LEAST_INSIDE = 0.1  # of the area: the whole result has at most ten times the pixels of the picture inside


def find_inside(image: UInt8Array) -> Inside | None:
    """Return rows and columns of the picture inside the borders of an image (H, W, 3); None without a border."""
    height, width = image.shape[:2]
    inside = slice(0, height), slice(0, width)
    for _ in range(2):  # the upper bar of a frame is found again without its sides
        rows, columns = inside
        start, stop = _between_bars(image[inside])
        rows = slice(rows.start + start, rows.start + stop)
        start, stop = _between_bars(image[rows, columns].transpose(1, 0, 2))
        inside = rows, slice(columns.start + start, columns.start + stop)
    sides = [part.stop - part.start for part in inside]
    if sides == [height, width] or min(sides) < MIN_SIDE or sides[0] * sides[1] < _LEAST_INSIDE * height * width:
        return None
    return inside


def _between_bars(rows: UInt8Array) -> tuple[int, int]:
    return _bar(rows), len(rows) - _bar(rows[::-1])


def _bar(rows: UInt8Array) -> int:
    """Return the number of rows (R, C, 3) of one colour before the straight edge of a picture; 0 without a bar."""
    samples = rows[:, :: max(1, rows.shape[1] // _MOST_SAMPLES)].astype(np.int16)
    difference = np.abs(samples - np.median(samples[0], axis=0)).max(-1)
    edge = int(((difference > _LEVELS).mean(1) >= _EDGE).argmax())
    stray = (difference[: max(edge - _RINGING_PX, edge // 2)] > _PLAIN).mean(1)
    return edge if edge >= _LEAST_BAR * len(rows) and (stray <= _STRAY).all() else 0


def cut_camera(camera: Intrinsics, size: tuple[int, int], inside: Inside) -> Intrinsics:
    """Return the camera of the picture inside. A principal point in the centre of the whole goes to its centre.

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
    return replace(camera, cx=camera.cx - columns.start, cy=camera.cy - rows.start, width=width, height=height)


def cut_border(
    photo: Photo, prompt: PeoplePrompt | None, known: KnownSizes, inside: Inside
) -> tuple[Photo, PeoplePrompt | None, KnownSizes]:
    """Return the picture inside, its camera, and the user's pixels in it; all in px of the photo's image."""
    size, (rows, columns) = photo.image.shape[:2], inside
    x, y = columns.start, rows.start
    cut = np.ascontiguousarray(photo.image[inside])
    note = (
        f"a border of one colour was cut for the computation; the picture inside has {cut.shape[1]} x {cut.shape[0]} px"
    )
    camera = None if photo.intrinsics is None else cut_camera(photo.intrinsics, (size[0], size[1]), inside)
    photo = replace(photo, image=cut, intrinsics=camera, notes=(*photo.notes, note))
    if prompt is not None:
        prompt = PeoplePrompt(
            tuple((px - x, py - y) for px, py in prompt.points),
            tuple((x0 - x, y0 - y, x1 - x, y1 - y) for x0, y0, x1, y1 in prompt.boxes),
            None if prompt.masks is None else prompt.masks[:, rows, columns],
        )
    lengths = tuple(
        replace(one, start=(one.start[0] - x, one.start[1] - y), end=(one.end[0] - x, one.end[1] - y))
        for one in known.lengths
    )
    return photo, prompt, replace(known, lengths=lengths)


@dataclass(frozen=True)
class Border(ShortRepr):
    """The whole photo around the picture that was reconstructed.

    Attributes:
        image: (H, W, 3) uint8 RGB, at the size of the result.
        left: of the picture inside, px.
        top: of the picture inside, px.
    """

    image: UInt8Array
    left: int
    top: int

    @classmethod
    def around(cls, inner: UInt8Array, whole: UInt8Array, inside: Inside) -> Border:
        """Return the border of a whole photo, resized like the picture inside."""
        rows, columns = inside
        height, width = inner.shape[:2]
        scale_x, scale_y = width / (columns.stop - columns.start), height / (rows.stop - rows.start)
        left, top = round(columns.start * scale_x), round(rows.start * scale_y)
        size = max(round(whole.shape[1] * scale_x), left + width), max(round(whole.shape[0] * scale_y), top + height)
        image: Any = cv2.resize(whole, size, interpolation=cv2.INTER_AREA)
        image[top : top + height, left : left + width] = inner
        return cls(image, left, top)

    def added_to(self, result: Reconstruction) -> Reconstruction:
        """Return a result in px of the whole photo; the border has no valid points."""
        (height, width), scene, camera = result.image.shape[:2], result.scene, result.intrinsics
        inside = slice(self.top, self.top + height), slice(self.left, self.left + width)
        shift = np.array([self.left, self.top] * 2, np.float32)

        def padded(values: Any, fill: float) -> Any:
            whole = np.full((*self.image.shape[:2], *values.shape[2:]), fill, values.dtype)
            whole[inside] = values
            return whole

        colors = self.image.copy()
        colors[inside] = scene.colors
        people = [
            replace(
                one,
                box=one.box + shift if one.mask.any() else one.box,
                mask=padded(one.mask, False),
                keypoints=one.keypoints + shift[:2],
            )
            for one in result.people
        ]
        unposed = [replace(one, box=tuple((np.array(one.box) + shift).tolist())) for one in result.unposed]
        size = {"width": self.image.shape[1], "height": self.image.shape[0]}
        return replace(
            result,
            image=self.image,
            intrinsics=replace(camera, cx=camera.cx + self.left, cy=camera.cy + self.top, **size),
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
