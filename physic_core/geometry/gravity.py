"""The direction of up in a photo, from the normals of its surfaces.

Man-made surfaces are level or upright, and so is the ground: up is the direction that level normals follow and upright
ones are square to (Gupta, Arbelaez and Malik, CVPR 2013, sec. 3).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

__all__ = ["Gravity", "gravity"]

_ROUNDS = ((45.0, 5), (20.0, 5), (10.0, 5))  # degrees off that still count as level or upright, and how often
_SAMPLES = 20_000
_FEWEST = 200


class Gravity(NamedTuple):
    """Up, and how clearly the surfaces show it.

    Attributes:
        up: (3,) unit, float64, camera frame.
        firmness: how much worse the surfaces agree with a direction that is turned about the worst axis, 0-1.
    """

    up: Tensor
    firmness: float


def gravity(normals: Tensor) -> Gravity | None:
    """Up, from unit surface normals (M, 3), camera frame (y down), zero where unknown; None where too few are known.

    The search begins at the camera's own up, which may be 45 degrees off.
    """
    known = normals[normals.square().sum(-1) > 0.5].double()
    if len(known) < _FEWEST:
        return None
    known = known[:: max(1, len(known) // _SAMPLES)]
    up = known.new_tensor([0.0, -1.0, 0.0])
    values = known.new_ones(3)
    for degrees, times in _ROUNDS:
        reach = math.radians(degrees)
        for _ in range(times):
            cosine = (known @ up).abs()
            level, upright = cosine > math.cos(reach), cosine < math.sin(reach)
            spread = known[upright].T @ known[upright] - known[level].T @ known[level]
            values, directions = torch.linalg.eigh(spread)
            up = -directions[:, 0] if float(directions[:, 0] @ up) < 0 else directions[:, 0]
    return Gravity(up, float(values[1] - values[0]) / len(known))
