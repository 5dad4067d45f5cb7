"""Penetration depth and volume, and floating distance, of bodies in a scene.

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
        volume: m^3, see :func:`penetration`.
    """

    max_depth: FloatArray
    mean_depth: FloatArray
    share: FloatArray
    volume: FloatArray


def penetration(
    distance: FloatArray, areas: FloatArray, facing: FloatArray | None = None, counted: BoolArray | None = None
) -> Penetration:
    """Compute depth, share and volume of the vertices inside the scene.

    The volume is the depth integrated over the skin inside. Without ``facing`` it is an upper bound: a ball of radius r
    with depth d gets pi r d^2, which is 1 / (1 - d / 3r) times the true volume. With ``facing`` it is exact for a plane
    (divergence theorem), up to the sampling by vertices.

    Args:
        distance: (..., V) m, signed.
        areas: (..., V) m^2, of :func:`vertex_areas`.
        facing: (..., V) in [-1, 1], minus the cosine between the body's outward normal and the scene's.
        counted: (..., V) bool, vertices that count (not those of mouth and eyes); all if None.
    """
    inside = np.isfinite(distance) & (distance < 0)
    if counted is not None:
        inside &= counted
    depth = np.where(inside, -np.asarray(distance, np.float64), 0.0)
    total = np.ones(depth.shape, bool) if counted is None else np.broadcast_to(counted, depth.shape)
    number = inside.sum(-1)
    weight = areas if facing is None else areas * np.where(inside, facing, 0.0)
    return Penetration(
        max_depth=depth.max(-1, initial=0.0),
        mean_depth=depth.sum(-1) / np.maximum(number, 1),
        share=number / np.maximum(total.sum(-1), 1),
        volume=(depth * weight).sum(-1),
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
