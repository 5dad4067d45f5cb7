"""Estimate the up direction of a photo from surface normals.

Most man-made surfaces are horizontal or vertical: normals are parallel or perpendicular to up (Gupta, Arbelaez and
Malik, CVPR 2013, sec. 3).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

_ROUNDS = ((45.0, 5), (20.0, 5), (10.0, 5))  # largest deviation in degrees, and number of iterations
_SAMPLES = 20_000
_FEWEST = 200


class UpEstimate(NamedTuple):
    """Up direction with its confidence.

    Attributes:
        up: (3,) unit, float64, camera frame.
        confidence: gap between the two smallest eigenvalues of the fit, per normal, 0-1.
    """

    up: Tensor
    confidence: float


def estimate_up(normals: Tensor, start: Tensor | None = None) -> UpEstimate | None:
    """Estimate the up direction from unit surface normals (M, 3), camera frame, zero where unknown.

    The search starts at ``start`` (3,) unit, or at the camera's own up axis; either may be wrong by 45 degrees, which a
    camera that looks down steeply exceeds. None if there are too few normals.
    """
    rows = (normals.square() @ normals.new_ones(3) > 0.5).nonzero()[:, 0]
    if len(rows) < _FEWEST:
        return None
    known = normals.index_select(0, rows[:: max(1, len(rows) // _SAMPLES)]).double()
    up = known.new_tensor([0.0, -1.0, 0.0]) if start is None else start.to(known)
    values = known.new_ones(3)
    for degrees, times in _ROUNDS:
        reach = math.radians(degrees)
        for _ in range(times):
            cosine = (known @ up).abs()
            level, upright = cosine > math.cos(reach), cosine < math.sin(reach)
            spread = known[upright].T @ known[upright] - known[level].T @ known[level]
            values, directions = torch.linalg.eigh(spread)
            up = -directions[:, 0] if float(directions[:, 0] @ up) < 0 else directions[:, 0]
    return UpEstimate(up, float(values[1] - values[0]) / len(known))
