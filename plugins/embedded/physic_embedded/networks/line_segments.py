"""Detect straight line segments with M-LSD."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import BoolArray, Float64Array, UInt8Array
    from physic_networks.onnx_sessions import OnnxSession

_SIDE = 512  # px of the network's square input; its output is a grid of half that side
_LEAST_SCORE = 0.15  # 0.1-0.3 works
_SHORTEST = 0.015  # segment, as a share of the long side
_MOST_INSIDE = 0.3  # share of a segment in a mask


def detect_line_segments(
    session: OnnxSession,
    image: UInt8Array,
) -> Float64Array:
    """Detect straight line segments in an image.

    Args:
        session: on ``mlsd_large_512``.
        image: (H, W, 3) uint8 RGB.

    Returns:
        (M, 2, 2) float64 px: M segments, two end points, (x, y).
    """
    import cv2

    height, width = image.shape[:2]
    fed = np.ones((1, _SIDE, _SIDE, 4), np.float32)  # the fourth channel is ones
    fed[0, ..., :3] = cv2.resize(image, (_SIDE, _SIDE), interpolation=cv2.INTER_AREA)
    offsets, scores = session.run(
        ["offsets", "scores"], {"input_image_with_alpha:0": fed}, keep=True
    )
    row, column = np.nonzero(scores[0, ..., 0] > _LEAST_SCORE)
    shift = offsets[0, row, column].reshape(-1, 2, 2)
    cells = np.stack([column, row], -1)[:, None] + shift
    # A cell of the answer is two pixels of the input: pixel centres move by half a pixel at each
    # resampling.
    scale = np.array([width, height]) / _SIDE
    ends = (2 * cells + 1) * scale - 0.5
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)
    return np.asarray(ends[length > _SHORTEST * max(height, width)], dtype=np.float64)


def segments_outside_mask(segments: Float64Array, mask: BoolArray) -> Float64Array:
    """Select the segments that lie mostly outside of a mask (H, W), such as the inpainted
    region.
    """

    height, width = mask.shape
    steps = np.linspace(0.0, 1.0, 9)[None, :, None]
    samples = np.round(segments[:, :1] * (1 - steps) + segments[:, 1:] * steps).astype(int)
    inside = mask[samples[..., 1].clip(0, height - 1), samples[..., 0].clip(0, width - 1)]
    return np.asarray(segments[inside.mean(1) <= _MOST_INSIDE])
