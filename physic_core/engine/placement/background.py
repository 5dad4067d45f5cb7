"""Background of the photo: the pixels that may be aligned to the scene, and their weights."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

_DEPTH_SHARE = 0.15  # standard deviation of the background weight, as a share of the inverse depth range
_FAR_WEIGHT = 0.05  # weight of background far from the people's depth


def nearness_to_people(depth: Tensor, valid: Tensor, people: Tensor, background: Tensor) -> Tensor | None:
    """Return the weight (H, W) of background by its difference of inverse depth to people.

    Two point maps of one scene differ by more than an affine map. Without weights, sky and far walls would dominate the
    alignment, and the ground at the feet would be wrong.
    """
    inverse = torch.where(valid & (depth > 0), 1 / depth, 0.0)
    own, others = inverse[people & (inverse > 0)], inverse[background & (inverse > 0)]
    if not len(own) or not len(others):
        return None
    low, high = _quantiles(own, 0.1, 0.9)
    spread = _quantiles(torch.cat((own, others)), 0.01, 0.99)
    extent = spread[1] - spread[0]
    if not extent > 0:
        return None
    gap = torch.maximum(low - inverse, inverse - high).clamp(min=0) / (_DEPTH_SHARE * extent)
    return _FAR_WEIGHT + (1 - _FAR_WEIGHT) * torch.exp(-0.5 * gap.square())


def _quantiles(values: Tensor, low: float, high: float) -> tuple[float, float]:
    """Return two quantiles of values (M,), of a subsample if there are many."""
    some = values[:: max(1, len(values) // 20_000)].double().sort().values
    last = len(some) - 1
    return float(some[round(low * last)]), float(some[round(high * last)])


def dilate_square(mask: Tensor, radius: int) -> Tensor:
    """Dilate a mask (H, W) by a square of ``radius`` px."""
    import cv2

    if radius < 1 or not mask.numel():
        return mask
    side = 2 * radius + 1
    grown = cv2.dilate(mask.cpu().numpy().view(np.uint8), np.ones((side, side), np.uint8))
    return torch.from_numpy(grown.view(bool)).to(mask.device)
