"""Cover the people whose poses are known, to find those beside and behind them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_embedded.networks.pose import LANDMARK_SIZE
from physic_embedded.networks.yolox import PADDING_VALUE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types import UInt8Array
    from physic_embedded.networks.pose import Pose


def grey_out(image: UInt8Array, poses: Sequence[Pose]) -> UInt8Array:
    """Return a copy of an image (H, W, 3) with the masks of poses in grey."""
    grey = image.copy()
    height, width = image.shape[:2]
    for pose in poses:
        corners = pose.square.to_photo(
            LANDMARK_SIZE * np.array([[0.0, 0.0], [1, 0], [0, 1], [1, 1]]), LANDMARK_SIZE
        )
        x0, y0 = np.maximum(np.floor(corners.min(axis=0)), 0).astype(int)
        x1, y1 = np.minimum(np.ceil(corners.max(axis=0)) + 1, [width, height]).astype(int)
        if x0 < x1 and y0 < y1:
            mask = pose.mask_on_grid(np.arange(x0, x1), np.arange(y0, y1))
            grey[y0:y1, x0:x1][mask > 0] = PADDING_VALUE
    return grey


def without_covered_joints(pose: Pose, others: Sequence[Pose]) -> Pose:
    """Return a pose found with other people in grey, with visibility 0 at the joints that they
    cover: the network takes grey for clothes.
    """
    visibility = pose.visibility.copy()
    for other in others:
        visibility[other.mask_at(pose.points) > 0] = 0
    return replace(pose, visibility=visibility)
