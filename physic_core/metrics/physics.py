"""Penetration depth and floating distance of bodies in a scene.

The input is each vertex's signed distance to scene or floor, in metres, negative inside. Distances that are inf or NaN
count as outside and out of reach.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray


@dataclass(frozen=True)
class Penetration:
    """Penetration of people, each (...,) float64; zero without a vertex inside.

    Attributes:
        max_depth: metres, of the deepest vertex.
        mean_depth: metres, over the vertices inside.
        share: of the counted vertices, those inside.
    """

    max_depth: FloatArray
    mean_depth: FloatArray
    share: FloatArray


def penetration(distance: FloatArray, counted: BoolArray | None = None) -> Penetration:
    """Compute depth and share of the vertices inside the scene.

    Args:
        distance: (..., V) m, signed.
        counted: (..., V) bool, vertices that count (not those of mouth and eyes); all if None.
    """
    total = np.ones(distance.shape, bool) if counted is None else np.broadcast_to(counted, distance.shape)
    inside = np.isfinite(distance) & (distance < 0) & total
    depth = np.where(inside, -np.asarray(distance, np.float64), 0.0)
    number = inside.sum(-1)
    return Penetration(
        max_depth=depth.max(-1, initial=0.0),
        mean_depth=depth.sum(-1) / np.maximum(number, 1),
        share=number / np.maximum(total.sum(-1), 1),
    )


def contact_gap(distance: FloatArray, contact: BoolArray, reach: float = float("inf")) -> FloatArray:
    """Return the mean gap (...,) m from true contact vertices to the scene; a vertex inside the scene has gap 0.

    Args:
        distance: (..., V) m, signed, of the predicted body in the predicted scene.
        contact: (..., V) bool, true contact.
        reach: upper limit of a gap, also of unknown ones.

    Returns:
        float64; NaN without true contact.
    """
    distance = np.asarray(distance, np.float64)
    outside = np.where(np.isnan(distance), np.inf, np.maximum(distance, 0.0))
    gap = np.where(contact, np.minimum(outside, reach), 0.0)
    number = contact.sum(-1)
    mean: FloatArray = np.where(number > 0, gap.sum(-1) / np.maximum(number, 1), np.nan)
    return mean
