"""Evidence of the scale of a scene: what one observation says of it, as a logarithm with its standard deviation.

The sizes that the user knows are the most certain evidence, a usual size the least. People are evidence, too: each says
a scale with the sigma of :mod:`.stature`, and since some of them are not adults, they vote in :mod:`.scale_vote`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

KNOWN_SIZE_SIGMA = 0.002
"""Expected error of the logarithm of a known size; 1 % off costs 25, as much as ten keypoints on a wrong limb."""

KNOWN_SCALE_SIGMA = 0.01
"""Expected error of log(scale) by a known size: its pixels and the floor are not exact."""

FACTOR_SPREAD = 0.05
"""Standard deviation of the logarithm of one size in the photo by another."""

CONTRADICTION = 3 * FACTOR_SPREAD
"""Difference of logarithms beyond which the photo contradicts a given size: three standard errors."""

DEPTH_SCALE_SIGMA = 0.1
"""Standard deviation of log(scale) of a metric depth whose backend states none."""

USUAL_CAMERA_HEIGHT_M = 1.45
"""Median height of a camera above the floor: people hold it at their chest or eyes, and some hang high indoors."""

USUAL_CAMERA_HEIGHT_SIGMA = 0.5
"""Standard deviation of the logarithm of that height."""

USUAL_DEPTH_M = 3.0
"""Median depth of a scene of people, of which nothing else is known."""

USUAL_DEPTH_SIGMA = 1.0
"""Standard deviation of the logarithm of that depth."""


@dataclass(frozen=True)
class ScaleEvidence:
    """Scale of a scene by one observation.

    Attributes:
        log_scale: logarithm of the factor on the scene.
        sigma: its standard deviation, > 0.
    """

    log_scale: float
    sigma: float

    @classmethod
    def by_known_size(cls, metres: float, shown: float) -> ScaleEvidence:
        """Return what a known size says that the scene shows with another one."""
        return cls(math.log(metres / shown), KNOWN_SCALE_SIGMA)


def combine(evidence: Sequence[ScaleEvidence]) -> ScaleEvidence | None:
    """Return the mean weighted by precision, in which the most certain evidence dominates; None without evidence.

    Its sigma is that of the most certain one: evidence of one kind shares its error.
    """
    if not evidence:
        return None
    least = min(e.sigma for e in evidence)
    weights = [(least / e.sigma) ** 2 for e in evidence]
    mean = sum(w * e.log_scale for w, e in zip(weights, evidence, strict=True)) / sum(weights)
    return ScaleEvidence(mean, least)
