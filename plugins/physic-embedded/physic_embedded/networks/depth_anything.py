"""Relative disparity of a photo with Depth Anything V2."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from onnxruntime import InferenceSession

__all__ = ["disparity", "network_size"]

_PATCH = 14  # px, side of the vision transformer's patches


def network_size(height: int, width: int, short_side: int = 518, max_tokens: int = 3600) -> tuple[int, int]:
    """Rows and columns to feed: the photo's aspect, multiples of 14, short side ``short_side``, at most ``max_tokens``
    patches (long panoramas would otherwise cost quadratically in time)."""
    scale = min(short_side / min(height, width), _PATCH * (max_tokens / (height * width)) ** 0.5)
    rows = max(_PATCH, round(height * scale / _PATCH) * _PATCH)
    columns = max(_PATCH, round(width * scale / _PATCH) * _PATCH)
    return rows, columns


def disparity(
    session: InferenceSession, image: NDArray[np.uint8], short_side: int = 518, max_tokens: int = 3600
) -> NDArray[np.float32]:
    """Disparity at the network's own resolution: an affine function of 1 / z, larger is nearer.

    Args:
        session: on ``depth_anything_v2_vits``.
        image: (H, W, 3) uint8 RGB.
        short_side: px of the network's input.
        max_tokens: cap on the number of patches.

    Returns:
        (h, w) float32, at least 0; :func:`network_size` gives h and w.
    """
    import cv2

    height, width = image.shape[:2]
    rows, columns = network_size(height, width, short_side, max_tokens)
    how = cv2.INTER_AREA if rows < height else cv2.INTER_CUBIC
    fed = cv2.resize(image, (columns, rows), interpolation=how).astype(np.float32)
    (answer,) = session.run(["depth"], {"image": np.ascontiguousarray(fed.transpose(2, 0, 1)[None])})
    return np.asarray(answer[0], dtype=np.float32)
