"""What the paper prints, to lay beside: PhySIC, Table 1 and Table 3, on the 178 frames of PROX's quantitative set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ["PAPER", "Printed"]


@dataclass(frozen=True)
class Printed:
    """One row: millimetres, and contact in [0, 1]; None where the paper prints nothing.

    The F1 is the harmonic mean of the precision and recall beside it.
    """

    pa_mpjpe_mm: float | None
    mpjpe_mm: float | None
    mpvpe_mm: float | None
    precision: float | None
    recall: float | None
    f1_of_means: float | None


PAPER: Mapping[str, Printed] = {
    "start": Printed(42.35, 997.49, 996.20, 0.406, 0.349, 0.376),
    "reprojection": Printed(76.79, 643.02, 641.31, 0.288, 0.052, 0.088),
    "contact": Printed(71.22, 637.50, 635.98, 0.397, 0.250, 0.307),
    "penetration": Printed(69.22, 639.16, 637.62, 0.394, 0.228, 0.289),
    "depth": Printed(72.64, 364.98, 358.75, 0.490, 0.430, 0.459),
    "occlusion": Printed(41.91, 238.72, 235.75, 0.490, 0.550, 0.518),
    "full": Printed(41.99, 230.26, 227.19, 0.508, 0.514, 0.511),
    "prox": Printed(73.31, 266.50, 266.00, 0.260, 0.108, 0.152),
    "static": Printed(41.96, None, None, None, None, 0.538),
}
"""Key of a row -> its numbers. The start is CameraHMR's bodies and DECO's contact."""
