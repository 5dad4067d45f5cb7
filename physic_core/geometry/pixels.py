"""Masks and values of pixels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch


def select_pixels(mask: torch.Tensor, *maps: torch.Tensor) -> tuple[torch.Tensor, ...]:
    """Return the values (M, ...) of maps (H, W, ...) at the M pixels of a mask (H, W), row by row.

    ``map[mask]`` takes four times as long.
    """
    rows = mask.flatten().nonzero()[:, 0]
    return tuple(values.flatten(0, 1).index_select(0, rows) for values in maps)


def dilate_square(mask: torch.Tensor, radius: int) -> torch.Tensor:
    """Dilate a mask (H, W) by a square of ``radius`` px."""
    import cv2

    if radius < 1 or not mask.numel():
        return mask
    side = 2 * radius + 1
    grown = cv2.dilate(mask.numpy().view(np.uint8), np.ones((side, side), np.uint8))
    return torch.from_numpy(grown.view(bool))


def span_of_true(hit: torch.Tensor, margin: int) -> slice:
    """Return the span of the true elements of ``hit`` (n,) bool, at least one, with a margin."""
    at = hit.nonzero()
    return slice(max(0, int(at[0]) - margin), int(at[-1]) + 1 + margin)


def quantiles(
    values: torch.Tensor, shares: Sequence[float], max_samples: int = 50_000
) -> list[float]:
    """Return quantiles of values (M,) without interpolation, of an even subsample of about
    ``max_samples`` if there are more.

    ``torch.quantile`` does not support large inputs.
    """
    some = values[:: max(1, len(values) // max_samples)].double().sort().values
    return [float(some[round(share * (len(some) - 1))]) for share in shares]


def median(values: torch.Tensor) -> torch.Tensor:
    """Return the median (...) of values (M, ...), M > 0: the mean of the two middle ones.

    ``torch.median`` is the lower one of them.
    """
    ordered = values.sort(0).values
    return (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2


def all_finite(points: torch.Tensor) -> torch.Tensor:
    """Return whether all coordinates of points (..., 3) are finite: (...) bool."""
    # A matrix product sums three columns several times faster than a reduction.
    return torch.isfinite(points @ points.new_ones(3))
