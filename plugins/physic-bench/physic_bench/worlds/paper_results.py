"""Results printed in the PhySIC paper, Tables 1 and 3: 178 frames of PROX's quantitative set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class PaperResult:
    """One row of the paper's table: errors in mm, contact scores in [0, 1]; None if not printed.

    The F1 is the harmonic mean of the precision and recall beside it.
    """

    pa_mpjpe_mm: float | None
    mpjpe_mm: float | None
    mpvpe_mm: float | None
    precision: float | None
    recall: float | None
    f1_of_means: float | None


PAPER_RESULTS: Mapping[str, PaperResult] = {
    "start": PaperResult(42.35, 997.49, 996.20, 0.406, 0.349, 0.376),
    "reprojection": PaperResult(76.79, 643.02, 641.31, 0.288, 0.052, 0.088),
    "contact": PaperResult(71.22, 637.50, 635.98, 0.397, 0.250, 0.307),
    "penetration": PaperResult(69.22, 639.16, 637.62, 0.394, 0.228, 0.289),
    "depth": PaperResult(72.64, 364.98, 358.75, 0.490, 0.430, 0.459),
    "occlusion": PaperResult(41.91, 238.72, 235.75, 0.490, 0.550, 0.518),
    "full": PaperResult(41.99, 230.26, 227.19, 0.508, 0.514, 0.511),
    "prox": PaperResult(73.31, 266.50, 266.00, 0.260, 0.108, 0.152),
    "static": PaperResult(41.96, None, None, None, None, 0.538),
}
"""Row key -> numbers in the paper. Row "start" has CameraHMR's bodies and DECO's contact."""
