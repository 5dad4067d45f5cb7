"""Predict relative disparity with Depth Anything V2."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from physic_core.adapters.pictures import IMAGENET_MEAN, letterbox

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.adapters.onnx_sessions import OnnxSession
    from physic_core.adapters.pictures import Resampling

_PATCH = 14  # px, side of the vision transformer's patches
# patches; a photo that is longer by less is shrunk instead of getting one more row or column of
# them
_OVERHANG = 0.1
_FILL = tuple(round(255 * mean) for mean in IMAGENET_MEAN)


def network_input_size(
    height: int, width: int, short_side: int = 518, max_tokens: int = 3600
) -> tuple[int, int]:
    """Return height and width of the network input: the multiples of 14 in which the photo fits.

    The short side is ``short_side`` px unless that gives more than about ``max_tokens`` patches,
    because long panoramas cost quadratic time. With 518 and 406 px, no usual aspect ratio is near
    the limit of another number of patches, so that a photo with a column less gets the same size.
    """
    scale = min(short_side / min(height, width), _PATCH * (max_tokens / (height * width)) ** 0.5)
    rows, columns = (
        max(1, math.ceil(side * scale / _PATCH - _OVERHANG)) * _PATCH for side in (height, width)
    )
    return rows, columns


def predict_disparity(
    session: OnnxSession, image: NDArray[np.uint8], short_side: int = 518, max_tokens: int = 3600
) -> NDArray[np.float32]:
    """Predict a disparity map at network resolution: an affine function of 1 / z, larger is nearer.

    The photo keeps its aspect ratio; the mean colour fills what it leaves of the input.

    Args:
        session: on ``depth_anything_v2_vits`` or ``depth_anything_v2_vits_int8``.
        image: (H, W, 3) uint8 RGB.
        short_side: px of the network's input.
        max_tokens: cap on the number of patches.

    Returns:
        (h, w) float32, at least 0, of the photo alone; at most of the size that
        :func:`network_input_size` gives.
    """
    height, width = image.shape[:2]
    rows, columns = network_input_size(height, width, short_side, max_tokens)
    how: Resampling = "area" if rows < height else "bicubic"
    canvas, photo = letterbox(image, rows, columns, fill=_FILL, how=how)
    fed = np.ascontiguousarray(canvas.transpose(2, 0, 1)[None], np.float32)
    (answer,) = session.run(["depth"], {"image": fed}, keep=True)
    return np.asarray(photo.crop(answer[0]), dtype=np.float32)
