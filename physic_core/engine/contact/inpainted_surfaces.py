"""Distances of body parts to inpainted surfaces, which stage 3 moves out of the bodies.

A moved surface follows the skin, so that every vertex above it is near. The surface before the move is off by some
centimetres, as the body is: a part that lies on it may be deep inside. What is inside touches with its deepest
vertices, so that the surface under a part is lowered until only these are inside; where the surface gives way, only by
what is deeper than that. This holds for level pieces of a surface, not for edges, bars and posts. Metres.
"""

from __future__ import annotations

import torch
from torch import Tensor

__all__ = ["lower_to_parts"]

_DEEPEST_SHARE = 0.1
"""Share of a part's vertices near the surface that may stay inside: single vertices do not decide."""

_MIN_VERTICES = 10
"""Least number of vertices of a part near the surface; fewer have no share that can be measured."""

_LEVEL = 0.9
"""Least length of the mean normal under a part; unit normals up to 50 degrees apart have 0.9."""


def lower_to_parts(
    distance: Tensor, before: Tensor, normals: Tensor, give: Tensor, inpainted: Tensor, part: Tensor
) -> Tensor:
    """Replace distances to moved surfaces by those to the surfaces before the move, lowered under each body part.

    Parts that are not inside a level piece keep their distances.

    Args:
        distance: (N, V) signed, to the moved surfaces.
        before: (N, V) signed, to the surfaces before the move; inf where none is near.
        normals: (N, V, 3) unit, of the surfaces before the move at their nearest points.
        give: (N, V) depth by which the surface gives way.
        inpainted: (N, V) bool, vertices whose nearest surface is inpainted; the others keep their distances.
        part: (V,) int64, body part of each vertex.

    Returns:
        (N, V) signed distances.
    """
    lowered = distance.clone()
    near = inpainted & torch.isfinite(before)
    inside = near & (before < 0)
    for i, mine in enumerate(inside):
        for p in torch.unique(part[mine]).tolist():
            here = near[i] & (part == p)
            level = normals[i, mine & (part == p)].mean(dim=0).norm() >= _LEVEL
            depth = before[i, here] + give[i, here].to(before)
            deepest = torch.quantile(depth, _DEEPEST_SHARE)
            if len(depth) >= _MIN_VERTICES and level and deepest < 0:
                lowered[i, here] = before[i, here] - deepest
    return lowered
