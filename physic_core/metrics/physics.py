"""Whether bodies and scene share space, or miss each other: penetration depth and volume, floating distance.

From the signed distance of each vertex to the scene or the floor: metres, positive outside, negative inside, inf or NaN
where nothing is known, which counts as outside and out of reach.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray

__all__ = ["Penetration", "contact_gap", "penetration", "vertex_areas", "vertex_normals"]


@dataclass(frozen=True)
class Penetration:
    """Of people, each (...,) float64; all zero where no vertex is inside.

    Attributes:
        max_depth: metres, of the deepest vertex.
        mean_depth: metres, over the vertices inside.
        share: of the counted vertices, those inside.
        volume: m^3, as :func:`penetration` says.
    """

    max_depth: FloatArray
    mean_depth: FloatArray
    share: FloatArray
    volume: FloatArray


def vertex_areas(vertices: FloatArray, faces: NDArray[np.integer[Any]]) -> FloatArray:
    """Area (..., V) m^2 of each vertex: a third of the triangles around it, so that they sum to the whole surface.

    Args:
        vertices: (..., V, 3) m, any frame.
        faces: (F, 3) vertex ids.
    """
    import torch

    from physic_core.geometry.visibility import vertex_areas as areas_of

    points, corners = torch.tensor(np.asarray(vertices, np.float64)), torch.tensor(np.asarray(faces, np.int64))
    areas: FloatArray = areas_of(points, corners).numpy()
    return areas


def vertex_normals(vertices: FloatArray, faces: NDArray[np.integer[Any]]) -> FloatArray:
    """Unit normals (..., V, 3) of each vertex, out of a mesh whose triangles run counter-clockwise.

    Args:
        vertices: (..., V, 3) m, any frame.
        faces: (F, 3) vertex ids.
    """
    import torch

    from physic_core.geometry.visibility import vertex_normals as normals_of

    points, corners = torch.tensor(np.asarray(vertices, np.float64)), torch.tensor(np.asarray(faces, np.int64))
    normals: FloatArray = normals_of(points, corners).numpy()
    return normals


def penetration(
    distance: FloatArray, areas: FloatArray, facing: FloatArray | None = None, counted: BoolArray | None = None
) -> Penetration:
    """Depth and volume of what lies inside.

    The volume is the integral of the depth over the body's surface inside. Without ``facing`` skin that stands steep to
    the scene's surface counts in full, so that it is an upper bound: a ball of radius r sunk by d gets pi r d^2, which
    is 1 / (1 - d / 3r) times the cap's true volume. With ``facing`` it is exact for a plane (divergence theorem), up to
    the sampling by vertices.

    Args:
        distance: (..., V) m, signed.
        areas: (..., V) m^2, of :func:`vertex_areas`.
        facing: (..., V) in [-1, 1], minus the cosine between the body's outward normal and the scene's: 1 where skin
            and scene face each other.
        counted: (..., V) bool, vertices that count (not those of mouth and eyes); all without it.
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
    """Mean gap (...,) m of the vertices that truly touch: how far contact is missed, where sunk ones miss by 0.

    Args:
        distance: (..., V) m, signed, of the predicted body in the predicted scene.
        contact: (..., V) bool, true contact.
        reach: farther and unknown vertices count as this far, for distances that were only looked for so far.

    Returns:
        float64; NaN where nothing truly touches.
    """
    gap = np.where(contact, np.minimum(_gap(distance), reach), 0.0)
    number = contact.sum(-1)
    mean: FloatArray = np.where(number > 0, gap.sum(-1) / np.maximum(number, 1), np.nan)
    return mean


def _gap(distance: FloatArray) -> FloatArray:
    values = np.asarray(distance, np.float64)
    return np.where(np.isnan(values), np.inf, np.maximum(values, 0.0))
