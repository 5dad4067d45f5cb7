"""Robust vote of people on the scale of a scene, and on the shift of its inverse depth.

A scene of depth Z' in its own unit has the metric depth Z with 1 / Z = (1 / Z' + t) / s. A person at depth z, whom the
scene alone would scale by m = z / Z', says s = m + t z. So people at different depths determine t as well: near people
the scale, far ones the shift.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.floating]

_SHIFTS = np.linspace(-3.0, 3.0, 241)  # tried shifts, in standard deviations


@dataclass(frozen=True)
class ScaleVote:
    """Result of a vote.

    Attributes:
        scale: s, metres per unit.
        shift: t, 1 / unit.
        sigma: standard deviation of log(s): the error that all voters share, and their disagreement.
        outliers: (N,) bool, voters whose scale differs by more than three standard errors.
        split: whether such voters have more than a third of the votes.
    """

    scale: float
    shift: float
    sigma: float
    outliers: NDArray[np.bool_]
    split: bool


def vote_on_scale(
    scales: FloatArray, depths: FloatArray, weights: FloatArray, sigma: float, shift_sigma: float
) -> ScaleVote:
    """Return the scale and shift with the least robust cost.

    Args:
        scales: (N,) m of each voter, metres per unit; NaN for people who do not vote.
        depths: (N,) z of each voter, metres.
        weights: (N,) > 0, how well the photo shows each voter.
        sigma: standard deviation of log(m).
        shift_sigma: standard deviation of the shift, 1 / unit; 0 if it is known.
    """
    voters = np.isfinite(scales)
    m, z, weight = scales[voters], depths[voters], weights[voters] / weights[voters].max()
    shifts = _SHIFTS * shift_sigma if shift_sigma and len(m) > 1 else np.zeros(1)
    candidates = np.log(np.maximum(m + shifts[:, None] * z, 1e-3 * m))  # (T, N)
    # Each voter's own scale is a candidate: cost (T, N candidates).
    misses = (candidates[:, None, :] - candidates[:, :, None]) / sigma
    cost = (np.log1p(misses**2) * weight).sum(-1)
    if len(shifts) > 1:
        cost = cost + ((shifts / shift_sigma) ** 2)[:, None]
    row, best = np.unravel_index(int(cost.argmin()), cost.shape)
    logs = candidates[row]
    middle = float(logs[best])
    for _ in range(20):
        kernel = weight / (1 + ((logs - middle) / sigma) ** 2)
        middle = float(np.average(logs, weights=kernel))
    share = weight / weight.sum()
    # Mean absolute deviation, as a standard deviation of the mean of so many voters.
    spread = 1.25 * float((share * np.abs(logs - middle)).sum() * np.sqrt((share**2).sum()))
    outliers = np.zeros(len(scales), bool)
    outliers[voters] = np.abs(logs - middle) > 3 * sigma
    split = float(share[outliers[voters]].sum()) > 1 / 3
    return ScaleVote(float(np.exp(middle)), float(shifts[row]), float(np.hypot(sigma, spread)), outliers, split)
