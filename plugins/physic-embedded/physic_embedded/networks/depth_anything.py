"""Predict relative disparity with Depth Anything V2."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.adapters.onnx_sessions import OnnxSession

_PATCH = 14  # px, side of the vision transformer's patches


def network_input_size(height: int, width: int, short_side: int = 518, max_tokens: int = 3600) -> tuple[int, int]:
    """Return height and width of the network input: multiples of 14, near the photo's aspect ratio.

    The short side is ``short_side`` px unless that gives more than ``max_tokens`` patches, because long panoramas cost
    quadratic time.
    """
    scale = min(short_side / min(height, width), _PATCH * (max_tokens / (height * width)) ** 0.5)
    rows = max(_PATCH, round(height * scale / _PATCH) * _PATCH)
    columns = max(_PATCH, round(width * scale / _PATCH) * _PATCH)
    return rows, columns


def predict_disparity(
    session: OnnxSession, image: NDArray[np.uint8], short_side: int = 518, max_tokens: int = 3600
) -> NDArray[np.float32]:
    """Predict a disparity map at network resolution: an affine function of 1 / z, larger is nearer.

    Args:
        session: on ``depth_anything_v2_vits`` or ``depth_anything_v2_vits_int8``.
        image: (H, W, 3) uint8 RGB.
        short_side: px of the network's input.
        max_tokens: cap on the number of patches.

    Returns:
        (h, w) float32, at least 0; :func:`network_input_size` gives h and w.
    """
    import cv2

    height, width = image.shape[:2]
    rows, columns = network_input_size(height, width, short_side, max_tokens)
    how = cv2.INTER_AREA if rows < height else cv2.INTER_CUBIC
    fed = cv2.resize(image, (columns, rows), interpolation=how).astype(np.float32)
    (answer,) = session.run(["depth"], {"image": np.ascontiguousarray(fed.transpose(2, 0, 1)[None])}, keep=True)
    return np.asarray(answer[0], dtype=np.float32)
