"""Undistort a photo once, after reading, and move the user's pixels of the file into the undistorted picture."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.geometry.distortion import check_distortion, undistort_image, undistort_pixels
from physic_core.types import KnownSizes, Lens, PeoplePrompt

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.io.photo import Photo
    from physic_core.types import BoolArray, FloatArray, Intrinsics

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
        InputError: the distortion folds the picture.
    """
    camera = photo.intrinsics
    assert camera is not None
    return (
        undistort_photo(photo, distortion),
        None if prompt is None else undistort_prompt(prompt, camera, distortion),
        undistort_sizes(known, camera, distortion),
    )


def undistort_photo(photo: Photo, distortion: Sequence[float]) -> Photo:
    """Return the photo as a camera of the same intrinsics without distortion sees it, with a note.

    Raises:
        InputError: the distortion folds the picture.
    """
    assert photo.intrinsics is not None
    check_distortion(photo.intrinsics, distortion)
    image = undistort_image(photo.image, photo.intrinsics, distortion)
    note = "the picture was undistorted; its pixels are not those of the file (Reconstruction.lens maps them back)"
    return replace(photo, image=image, notes=(*photo.notes, note))


def undistort_sizes(known: KnownSizes, camera: Intrinsics, distortion: Sequence[float]) -> KnownSizes:
    """Move the pixels of known lengths from the distorted into the undistorted picture."""

    def move(at: tuple[float, float]) -> tuple[float, float]:
        x, y = undistort_pixels(np.array([at]), camera, distortion)[0].tolist()
        return x, y

    lengths = tuple(replace(length, start=move(length.start), end=move(length.end)) for length in known.lengths)
    return replace(known, lengths=lengths)


def undistort_prompt(prompt: PeoplePrompt, camera: Intrinsics, distortion: Sequence[float]) -> PeoplePrompt:
    """Move points, boxes and masks of people from the distorted into the undistorted picture.

    A box becomes the smallest one around its undistorted border.
    """
    points = tuple(
        (float(x), float(y)) for x, y in undistort_pixels(np.array(prompt.points).reshape(-1, 2), camera, distortion)
    )
    boxes = tuple(_box(box, camera, distortion) for box in prompt.boxes)
    masks = None if prompt.masks is None else np.stack([_mask(m, camera, distortion) for m in prompt.masks])
    return PeoplePrompt(points, boxes, masks)


def _box(
    box: tuple[float, float, float, float], camera: Intrinsics, distortion: Sequence[float]
) -> tuple[float, float, float, float]:
    x0, y0, x1, y1 = (v - 0.5 for v in box)  # edges of a box are half open, pixels have their centres at integers
    x, y = np.linspace(x0, x1, _EDGE_POINTS), np.linspace(y0, y1, _EDGE_POINTS)
    border = np.concatenate(
        [np.stack([x, 0 * x + edge], -1) for edge in (y0, y1)] + [np.stack([0 * y + edge, y], -1) for edge in (x0, x1)]
    )
    moved = undistort_pixels(border, camera, distortion) + 0.5
    (left, top), (right, bottom) = moved.min(0).tolist(), moved.max(0).tolist()
    return left, top, right, bottom


def _mask(mask: BoolArray, camera: Intrinsics, distortion: Sequence[float]) -> BoolArray:
    """Sample a mask (H, W) at the nearest pixel of the distorted picture."""
    height, width = mask.shape
    y, x = np.mgrid[:height, :width]
    lens = Lens(camera, (*distortion,))  # type: ignore[arg-type]
    at = np.rint(lens.file_pixels(np.stack([x, y], -1), camera)).astype(int)
    inside = ((at >= 0) & (at < [width, height])).all(-1)
    clipped: FloatArray = np.clip(at, 0, [width - 1, height - 1])
    found: BoolArray = inside & mask[clipped[..., 1], clipped[..., 0]]
    return found
