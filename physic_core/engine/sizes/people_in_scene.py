"""Size of people in a scene of known scale."""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.engine.sizes.stature import STATURE_SIGMA

_CERTAIN = 0.2  # log factor beyond which a person is not an adult of the prior, such as a child
FACTOR_SPREAD = 0.05
"""Standard deviation of the logarithm of one size in the photo by another."""
CONTRADICTION = 3 * FACTOR_SPREAD
"""Difference of logarithms beyond which the photo contradicts a given size: three standard errors."""
STATURES_M = (0.5, 2.2)
"""Limits of the stature of people whose size follows from the scene."""


def stature_factor(measured: Tensor, stature: Tensor) -> Tensor:
    """Return the factor (B,) on the estimated statures of people in a scene of known scale.

    The estimate is a prior of adults, and the scene measures each person with an error. Both are combined by their
    spreads, unless they differ so much that the prior cannot hold.

    Args:
        measured: (B,) factor by which the scene asks to enlarge each person, NaN where unknown.
        stature: (B,) metres, estimated.
    """
    log = torch.nan_to_num(measured, nan=1.0).log()
    trust = STATURE_SIGMA**2 / (STATURE_SIGMA**2 + FACTOR_SPREAD**2)
    share = 1 - (1 - trust) * torch.exp(-(log / _CERTAIN).square())
    least, most = (limit / stature for limit in STATURES_M)
    return (log * share).exp().clamp(least.clamp(max=1.0), most.clamp(min=1.0))
