"""Prepare photos for networks and map results back: resizing, letterboxing, normalisation, masks to
fill.

Integer pixel coordinates are pixel centres. So coordinate x of an image becomes (x + 0.5) s - 0.5
after resizing by s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from physic_core.backends.masks import dilate
from physic_core.errors import BackendError, InputError
from physic_core.interfaces import tensor_advice

if TYPE_CHECKING:
    from collections.abc import Callable

    from physic_core.types import AnyArray, BoolArray, FloatArray, UInt8Array

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)

Resampling = Literal["bilinear", "bicubic", "area", "bilinear-antialias", "bicubic-antialias"]
"""Interpolation methods: "bilinear", "bicubic" and "area" are as in OpenCV and torch; with
"antialias", as in Pillow.
"""

_CHANNELS = 4  # OpenCV 5 takes 128 at most, its "area" no more than 4


def normalized_nchw(
    image: AnyArray,
    mean: Sequence[float] = (0.0, 0.0, 0.0),
    std: Sequence[float] = (1.0, 1.0, 1.0),
    scale: float = 1 / 255,
) -> FloatArray:
    """Convert an image (H, W, 3) to network input (1, 3, H, W) float32: (image * scale - mean) /
    std.
    """
    factor = scale / np.asarray(std, np.float64)
    offset = np.asarray(mean, np.float64) / np.asarray(std, np.float64)
    values = np.ascontiguousarray(image.transpose(2, 0, 1), np.float32)
    values = (
        values * factor.astype(np.float32)[:, None, None] - offset.astype(np.float32)[:, None, None]
    )
    return np.asarray(values[None], np.float32)


def resize_image(
    image: AnyArray, height: int, width: int, how: Resampling = "bilinear"
) -> AnyArray:
    """Resize an image to exactly ``height`` x ``width``; the aspect may change.

    Args:
        image: (H, W) or (H, W, C) uint8 or float32, with any number of channels.
        height: px.
        width: px.
        how: see :data:`Resampling`.

    Returns:
        The image with the same type of values; uint8 are rounded and clipped.

    Raises:
        InputError: ``image`` is not such an array, or the size is not positive.
    """
    if height < 1 or width < 1:
        raise InputError(f"an image cannot be resized to {width} x {height} px")
    _require_picture(image)
    if image.dtype not in (np.uint8, np.float32):
        raise InputError(
            f"an image to resize must hold uint8 or float32, got {image.dtype}: convert it"
        )
    if image.shape[:2] == (height, width):
        return image.copy()
    channels = image[..., None] if image.ndim == 2 else image
    count = channels.shape[2]
    if how.endswith("antialias"):
        resize = _resize_by_pillow
        at_once = 3 if count == 3 and image.dtype == np.uint8 else 1
    else:
        resize = _resize_by_opencv
        at_once = _CHANNELS
    whole = np.empty((height, width, count), image.dtype)
    for first in range(0, count, at_once):
        part = np.ascontiguousarray(channels[..., first : first + at_once])
        whole[..., first : first + at_once] = resize(part, height, width, how)
    return whole.reshape(height, width, *image.shape[2:])


def resize_map(values: AnyArray, height: int, width: int) -> FloatArray:
    """Resize a map (H, W) or (H, W, C) by bilinear interpolation, to float32; NaN spreads to
    neighbours.

    Raises:
        InputError: ``values`` is not an array of numbers, or the size is not positive.
    """
    _require_picture(values)
    return resize_image(np.asarray(values, np.float32), height, width, "bilinear")


def _require_picture(image: object) -> None:
    """Raise InputError unless an image is a plain numpy array (H, W) or (H, W, C) of real numbers
    that has pixels.
    """
    if type(image) not in (np.ndarray, np.memmap):
        advice = tensor_advice(image) or ": write numpy.asarray(...)"
        raise InputError(
            f"an image to resize must be a numpy array, got {type(image).__name__}{advice}"
        )
    assert isinstance(image, np.ndarray)
    if image.ndim not in (2, 3) or 0 in image.shape[:2]:
        raise InputError(
            f"an image to resize must be (H, W) or (H, W, C), with pixels, got {image.shape}"
        )
    if image.dtype.kind not in "biuf":
        raise InputError(
            f"an image to resize must hold bool, integers or floats, got {image.dtype}: convert it"
        )


def _resize_by_opencv(part: AnyArray, height: int, width: int, how: str) -> AnyArray:
    """Resize up to four channels (H, W, c) with OpenCV."""
    import cv2

    kinds = {"bilinear": cv2.INTER_LINEAR, "bicubic": cv2.INTER_CUBIC, "area": cv2.INTER_AREA}
    resized: AnyArray = cv2.resize(part, (width, height), interpolation=kinds[how])
    return resized.reshape(height, width, -1)


def _resize_by_pillow(part: AnyArray, height: int, width: int, how: str) -> AnyArray:
    """Resize one channel (H, W, 1), or three of uint8, with Pillow."""
    from PIL import Image

    kinds = {"bilinear": Image.Resampling.BILINEAR, "bicubic": Image.Resampling.BICUBIC}
    kind = kinds[how.removesuffix("-antialias")]
    plane = Image.fromarray(part if part.shape[2] == 3 else part[..., 0])
    return np.asarray(plane.resize((width, height), kind)).reshape(height, width, -1)


@dataclass(frozen=True)
class Letterbox:
    """Position and scale of a photo in a letterboxed canvas.

    Attributes:
        scale: canvas pixels per photo pixel, before the size was rounded.
        left: columns of the canvas left of the photo.
        top: rows of the canvas above the photo.
        inner: height and width of the photo in the canvas, px.
        size: height and width of the original photo, px.
    """

    scale: float
    left: int
    top: int
    inner: tuple[int, int]
    size: tuple[int, int]

    def to_photo(self, points: AnyArray) -> FloatArray:
        """Map pixel coordinates (..., 2) x y from the canvas to the photo."""
        return np.asarray((points - self._offset() + 0.5) / self._factor() - 0.5, np.float64)

    def to_canvas(self, points: AnyArray) -> FloatArray:
        """Map pixel coordinates (..., 2) x y from the photo to the canvas."""
        return np.asarray((points + 0.5) * self._factor() - 0.5 + self._offset(), np.float64)

    def edges_to_photo(self, boxes: AnyArray) -> FloatArray:
        """Map half-open boxes (..., 4) x0 y0 x1 y1, which are pixel edges, from the canvas to the
        photo.
        """
        return np.asarray(
            (boxes - np.tile(self._offset(), 2)) / np.tile(self._factor(), 2), np.float64
        )

    def crop(self, values: AnyArray) -> AnyArray:
        """Return the part of a map (h, w, ...) of the canvas that the photo covers, as a view."""
        return values[self.top : self.top + self.inner[0], self.left : self.left + self.inner[1]]

    def _factor(self) -> FloatArray:
        return np.array([self.inner[1] / self.size[1], self.inner[0] / self.size[0]])

    def _offset(self) -> FloatArray:
        return np.array([self.left, self.top], np.float64)


def letterbox(
    image: UInt8Array,
    height: int,
    width: int,
    fill: float | Sequence[float] = 0,
    where: Literal["top-left", "centre"] = "centre",
    how: Resampling = "bilinear",
) -> tuple[AnyArray, Letterbox]:
    """Resize a photo into a padded canvas, keeping its aspect.

    Args:
        image: (H, W, 3) uint8 or float32.
        height: of the canvas, px.
        width: of the canvas, px.
        fill: padding value, one or one per channel.
        where: position of the photo.
        how: see :data:`Resampling`.
    """
    rows, columns = image.shape[:2]
    scale = min(height / rows, width / columns)
    inner = (max(1, min(height, round(rows * scale))), max(1, min(width, round(columns * scale))))
    top, left = ((height - inner[0]) // 2, (width - inner[1]) // 2) if where == "centre" else (0, 0)
    box = Letterbox(scale, left, top, inner, (rows, columns))
    canvas = np.empty((height, width, *image.shape[2:]), image.dtype)
    canvas[:] = np.asarray(fill).astype(image.dtype)
    box.crop(canvas)[:] = resize_image(image, *inner, how)
    return canvas, box


def check_mask(image: UInt8Array, mask: BoolArray) -> BoolArray:
    """Return the mask (H, W) of an image (H, W, 3) as bool, after checking its size.

    Raises:
        BackendError: its size differs from the image's, or it covers the complete image.
    """
    mask = np.asarray(mask, bool)
    if mask.shape != image.shape[:2]:
        raise BackendError(
            f"the mask must have the image's size (H, W) = {image.shape[:2]}, got {mask.shape}: "
            f"resize it first"
        )
    if mask.all():
        raise BackendError(
            "the mask covers the whole image, which leaves nothing to fill it from: pass a "
            "smaller one"
        )
    return mask


def inpaint_masked(
    image: UInt8Array,
    mask: BoolArray,
    rim: float,
    fill: Callable[[UInt8Array, BoolArray], UInt8Array],
) -> UInt8Array:
    """Inpaint the pixels of a mask; pixels outside it are not changed.

    Args:
        image: (H, W, 3).
        mask: (H, W), True = fill.
        rim: the mask passed to ``fill`` is dilated by this share of the long side.
        fill: inpainting function of the image and the dilated mask; not called for an empty mask.

    Raises:
        BackendError: the mask's size differs from the image's, or it covers the complete image.
    """
    mask = check_mask(image, mask)
    return (
        np.where(mask[..., None], fill(image, dilate_mask(mask, rim)), image)
        if mask.any()
        else image.copy()
    )


def dilate_mask(mask: BoolArray, share: float) -> BoolArray:
    """Dilate a mask by a disc, whose radius is ``share`` times the long side of the mask array.

    The mask is unchanged if the result would cover the complete image.
    """
    wider = dilate(mask, share * max(mask.shape))
    return mask if wider.all() else wider
