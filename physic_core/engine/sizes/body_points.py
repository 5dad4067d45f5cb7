"""Point of a body at a pixel. OpenCV camera frame, metres."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.geometry.camera import project
from physic_core.geometry.visibility import facing_camera

_NEIGHBOURS = 4  # vertices that give the depth of a body at a pixel
_FACING_DEG = 89.0


@dataclass(frozen=True)
class BodyPoint:
    """Point of a body at a pixel: on its ray, at the weighted mean depth of the nearest visible vertices.

    Attributes:
        ids: (k,) int64.
        weight: (k,), sums to 1.
        ray: (3,) with z = 1.
    """

    ids: Tensor
    weight: Tensor
    ray: Tensor

    def __call__(self, vertices: Tensor) -> Tensor:
        """Return the point (3,) on a body with vertices (V, 3); differentiable."""
        point: Tensor = self.ray * (vertices[self.ids, 2] @ self.weight)
        return point


def vertices_at_ray(vertices: Tensor, normals: Tensor, ray: Tensor, K: Tensor) -> BodyPoint:
    """Choose the vertices of a body (V, 3) with normals (V, 3) that give its depth at a pixel's ray (3,)."""
    seen = facing_camera(normals, vertices, _FACING_DEG)
    seen = seen if bool(seen.any()) else torch.ones_like(seen)
    away = (project(vertices, K) - project(ray[None], K)).square().sum(-1)
    away = torch.where(seen, away, torch.inf)
    nearest, ids = away.topk(min(_NEIGHBOURS, int(seen.sum())), largest=False)
    # A vertex of a limb behind can project between those of the limb in front.
    front = vertices[ids, 2] < vertices[ids, 2].amin() + 0.1
    weight = front / (nearest + 0.25)
    return BodyPoint(ids, weight / weight.sum(), ray)
