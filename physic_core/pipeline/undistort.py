"""Undistort a photo once, after reading, and map the user's pixels of the file to the undistorted image."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.types import KnownSizes, Lens, PeoplePrompt

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from physic_core.io.photo import Photo
    from physic_core.types import BoolArray, FloatArray

    Move = Callable[[FloatArray], FloatArray]

_EDGE_POINTS = 9  # along each side of a box


def undistort(
    photo: Photo, prompt: PeoplePrompt | None, known: KnownSizes, distortion: Sequence[float]
) -> tuple[Photo, PeoplePrompt | None, KnownSizes]:
    """Undistort a photo with known intrinsics, and the user's pixels in it.

    Args:
        photo: its intrinsics are those of the image, of any size.
        prompt: chosen people, px of the image.
        known: known sizes, px of the image.
        distortion: k1, k2, p1, p2, k3.

    Raises:
        InputError: the distortion folds the image.
    """
    # It imports torch, which other photos load beside the first network.
    from physic_core.geometry.camera import check_distortion, undistort_image, undistort_pixels

    camera = photo.intrinsics
    assert camera is not None
    check_distortion(camera, distortion)
    image = undistort_image(photo.image, camera, distortion)
    note = "the image was undistorted; its pixels are not those of the file (Reconstruction.lens maps them back)"
    photo = replace(photo, image=image, notes=(*photo.notes, note))

    def move(pixels: FloatArray) -> FloatArray:
        return undistort_pixels(pixels, camera, distortion)

    lens = Lens(camera, (*distortion,))  # type: ignore[arg-type]
    return photo, *move_pixels(prompt, known, move, lambda mask: _mask(mask, lens))


def move_pixels(
    prompt: PeoplePrompt | None, known: KnownSizes, move: Move, move_mask: Callable[[BoolArray], BoolArray]
) -> tuple[PeoplePrompt | None, KnownSizes]:
    """Return the user's pixels of an image in another one.

    Args:
        prompt: chosen people, px of the image.
        known: known sizes, px of the image.
        move: from pixels (n, 2) to those of the other image.
        move_mask: from a mask (H, W) to that of the other image.
    """
    if prompt is not None:
        points = tuple((float(x), float(y)) for x, y in move(np.array(prompt.points).reshape(-1, 2)))
        boxes = tuple(_box(box, move) for box in prompt.boxes)
        masks = None if prompt.masks is None else np.stack([move_mask(mask) for mask in prompt.masks])
        prompt = PeoplePrompt(points, boxes, masks)
    lengths = []
    for length in known.lengths:
        start, end = move(np.array([length.start, length.end])).tolist()
        lengths.append(replace(length, start=(start[0], start[1]), end=(end[0], end[1])))
    return prompt, replace(known, lengths=tuple(lengths))


def _box(box: tuple[float, float, float, float], move: Move) -> tuple[float, float, float, float]:
    """Return the smallest box around the undistorted border of a box."""
    x0, y0, x1, y1 = (v - 0.5 for v in box)  # edges of a box are half open, pixels have their centres at integers
    x, y = np.linspace(x0, x1, _EDGE_POINTS), np.linspace(y0, y1, _EDGE_POINTS)
    border = np.concatenate(
        [np.stack([x, 0 * x + edge], -1) for edge in (y0, y1)] + [np.stack([0 * y + edge, y], -1) for edge in (x0, x1)]
    )
    moved = move(border) + 0.5
    (left, top), (right, bottom) = moved.min(0).tolist(), moved.max(0).tolist()
    return left, top, right, bottom


def _mask(mask: BoolArray, lens: Lens) -> BoolArray:
    """Sample a mask (H, W) at the nearest pixel of the distorted image."""
    height, width = mask.shape
    y, x = np.mgrid[:height, :width]
    at = np.rint(lens.file_pixels(np.stack([x, y], -1), lens.intrinsics)).astype(int)
    inside = ((at >= 0) & (at < [width, height])).all(-1)
    clipped: FloatArray = np.clip(at, 0, [width - 1, height - 1])
    found: BoolArray = inside & mask[clipped[..., 1], clipped[..., 0]]
    return found
