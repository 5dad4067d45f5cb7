"""Prior of adults' statures, and the shape of a body of the mean stature.

A photo of one person hardly shows how tall the person is, so that the mean decides the distance. Barefoot adults in
high-income countries measure 1.78 m (men) and 1.65 m (women) in the mean (NCD-RisC, eLife 2016;5:e13410). Within each
sex the standard deviation is 6.4 to 6.9 cm (ANSUR II, Gordon et al. 2014). Men and women alike, that is 1.715 m with a
standard deviation of 9.3 cm. People in photos wear shoes, whose soles are the soles of the fitted body: 2.5 cm more.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

ADULT_STATURE_M = 1.715 + 0.025
"""Mean height of adults in shoes, metres."""

ADULT_STATURE_SPREAD_M = 0.093
"""Standard deviation of adults' heights, metres."""


def adult_shape(mean_stature: float, slope: Tensor) -> Tensor:
    """Return the most probable betas (K,) of a body of :data:`ADULT_STATURE_M`.

    Args:
        mean_stature: of zero betas, metres.
        slope: (K,) metres that one unit of each component adds.
    """
    return slope * (ADULT_STATURE_M - mean_stature) / slope.square().sum()
