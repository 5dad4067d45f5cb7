"""Settings of the reprojection term, which the checks read without torch."""

from __future__ import annotations

from dataclasses import dataclass

from physic_core.types.bounds import NotNegative, Positive


@dataclass(frozen=True)
class ReprojectionSettings:
    """Settings of the reprojection term: projected joints of the body against keypoints."""

    weight: NotNegative = 1.0
    """Lambda_j2d of Eq. 5; 0 removes the term."""
    sigma: Positive = 0.01
    """Expected error, as a share of the person's stature in px."""
    outlier_sigmas: Positive = 5.0
    """Beyond this many sigmas a keypoint counts as an outlier (Cauchy)."""
