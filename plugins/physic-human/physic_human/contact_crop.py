"""Crop network input for DECO-like contact networks: an enlarged box on a white square, in BGR.

Such networks were trained on images read by OpenCV. So channels are in the order blue, green, red, but mean and
standard deviation of ImageNet keep their RGB order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD, normalized_nchw

if TYPE_CHECKING:
    from physic_core.types import FloatArray, UInt8Array

INPUT_SIDE = 256
"""Height and width of the network's square input, px."""
BOX_GROWTH = 0.1
"""Share of its width and height by which a box is enlarged on every side."""
_WHITE = 255


def enlarged_box_slices(box: FloatArray, height: int, width: int, growth: float = BOX_GROWTH) -> tuple[slice, slice]:
    """Enlarge a box (4,) x0 y0 x1 y1 px, clip it to the image, and return its row and column slices."""
    x0, y0, x1, y1 = (float(v) for v in box)
    dx, dy = growth * (x1 - x0), growth * (y1 - y0)
    return _span(y0 - dy, y1 + dy, height), _span(x0 - dx, x1 + dx, width)


def contact_crop(
    image: UInt8Array,
    box: FloatArray,
    *,
    growth: float = BOX_GROWTH,
    fit: Literal["letterbox", "squash"] = "letterbox",
) -> FloatArray:
    """Return the network input (3, 256, 256) float32 for one person.

    Args:
        image: (H, W, 3) uint8 RGB.
        box: (4,) x0 y0 x1 y1 px, half open.
        growth: the box is enlarged by this share of its size on every side.
        fit: "letterbox" keeps the aspect and pads with white; "squash" stretches the box to a square.
    """
    import cv2

    rows, columns = enlarged_box_slices(box, image.shape[0], image.shape[1], growth)
    cut = np.ascontiguousarray(image[rows, columns, ::-1])
    height, width = cut.shape[:2]
    scale = INPUT_SIDE / max(height, width)
    size = (INPUT_SIDE, INPUT_SIDE) if fit == "squash" else (max(int(width * scale), 1), max(int(height * scale), 1))
    small = cv2.resize(cut, size, interpolation=cv2.INTER_CUBIC)
    square = np.full((INPUT_SIDE, INPUT_SIDE, 3), _WHITE, np.uint8)
    left, top = (INPUT_SIDE - size[0]) // 2, (INPUT_SIDE - size[1]) // 2
    square[top : top + size[1], left : left + size[0]] = small
    # The RGB mean and deviation are applied to BGR channels, as in the training of these networks.
    found: FloatArray = normalized_nchw(square, IMAGENET_MEAN, IMAGENET_STD)[0]
    return found


def _span(low: float, high: float, end: int) -> slice:
    """Return a slice from ``low`` to ``high``, clipped to [0, end) and at least 1 long."""
    first = min(max(int(low), 0), end - 1)
    return slice(first, max(min(int(high), end), first + 1))
