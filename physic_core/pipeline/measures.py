"""Measures of one person for the self-checks: visible share, gaps to the support, heights and depth ratio.

OpenCV camera frame, metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch

from physic_core.engine.contact.distance import SEARCH_RADIUS_M
from physic_core.engine.contact.parts import SEAT
from physic_core.engine.touch import LEAST_PROBABILITY
from physic_core.geometry.camera import project
from physic_core.geometry.mesh import vertex_areas
from physic_core.geometry.visibility import facing_camera, inside_mask
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from collections.abc import Mapping

    from torch import Tensor

    from physic_core.body.model import BodyModel


@dataclass(frozen=True)
class UpAndFloor:
    """Up direction and floor position.

    Attributes:
        up: (3,) unit.
        offset: the floor is ``up . X + offset = 0``, metres; None without a floor.
    """

    up: Tensor
    offset: float | None


_FACING_DEG = 70.0  # degrees; vertices beyond lie at the rim, where one pixel of the mask decides
_DOWNWARD = -0.3  # cosine between a normal and up: supporting vertices face down
_MIN_VERTICES = 20  # vertices with a depth, for a median
_MOST = 0.9  # quantile of the ways of moved points


def visible_share(
    vertices: Tensor, normals: Tensor, faces: Tensor, outer: Tensor, mask: Tensor, K: Tensor
) -> float | None:
    """Compute the share of the camera-facing surface inside the person's mask; None without such a surface.

    Parts outside the frame or occluded by people or objects are not visible.

    Args:
        vertices: (V, 3) metres.
        normals: (V, 3) unit, out of the body.
        faces: (F, 3) int64.
        outer: (V,) bool, False in mouth and eyes.
        mask: (H, W) bool, the person's visible pixels.
        K: (3, 3) px.
    """
    area = vertex_areas(vertices, faces) * _camera_facing(vertices, normals, outer)
    total = float(area.sum())
    return float((area * inside_mask(project(vertices, K), mask)).sum()) / total if total > 0 else None


def carrying_vertices(model: BodyModel, parts: Mapping[str, Tensor]) -> Tensor:
    """Return the vertices (N, V) bool that may carry: no foot in the air, and of people who stand the feet alone.

    Args:
        model: body model of N people.
        parts: body part -> (N,) probability that it touches; if it is empty, all outer vertices may carry, (V,).
    """
    if not parts:
        return model.outer
    feet = torch.stack([model.part_of_vertex == model.part_names.index(f"{side}_foot") for side in SIDES])
    touch = torch.stack([parts[f"{side}_foot"] for side in SIDES], 1) >= LEAST_PROBABILITY
    stands = touch.all(1) & (parts[SEAT] < LEAST_PROBABILITY)
    in_air = (~touch[:, :, None] & feet).any(1)
    return model.outer & ~in_air & (feet.any(0) | ~stands[:, None])


def support_gap(
    vertices: Tensor, normals: Tensor, may_carry: Tensor, distance: Tensor, ground: UpAndFloor
) -> float | None:
    """Compute the gap between supporting vertices and the nearest surface or floor, metres; 0 if they touch.

    The supporting vertices are those that may carry and face down. With no surface within the search radius the gap is
    the height above the floor, or that radius without a floor; None without such vertices.

    Args:
        vertices: (V, 3).
        normals: (V, 3) unit, out of the body.
        may_carry: (V,) bool.
        distance: (V,) signed, to scene or floor; inf beyond ``SEARCH_RADIUS_M``.
        ground: of the scene.
    """
    height = vertices @ ground.up
    supporting = may_carry & (normals @ ground.up < _DOWNWARD)
    if not supporting.any():
        return None
    gap = float(distance[supporting].min())
    if ground.offset is not None:
        gap = min(gap, float(height[supporting].min()) + ground.offset)
    elif gap == float("inf"):
        gap = SEARCH_RADIUS_M
    return max(0.0, gap)


def clearance(vertices: Tensor, distance: Tensor, ground: UpAndFloor) -> float | None:
    """Compute the gap between a body and the nearest surface or floor, metres; 0 if any vertex touches.

    Unlike :func:`support_gap`, all vertices count, visible or not. None without a floor or a surface in reach.

    Args:
        vertices: (V, 3).
        distance: (V,) signed, to scene or floor; inf beyond the search radius.
        ground: of the scene.
    """
    gap = float(distance.min())
    if ground.offset is not None:
        gap = min(gap, float((vertices @ ground.up).min()) + ground.offset)
    return max(0.0, gap) if gap != float("inf") else None


def sole_height(vertices: Tensor, soles: Tensor, ground: UpAndFloor) -> float | None:
    """Return the height of the lowest sole vertex over the floor, metres, negative below it; None without a floor.

    Args:
        vertices: (V, 3).
        soles: indices of the sole vertices.
        ground: of the scene.
    """
    return None if ground.offset is None else float((vertices[soles] @ ground.up).min()) + ground.offset


def moved_scene(points: Tensor, before: Tensor, mask: Tensor) -> float | None:
    """Return how far inpainted scene points were moved back behind a person: the 0.9 quantile, in the points' unit.

    None with too few moved points.

    Args:
        points: (H, W, 3) of the final scene.
        before: (H, W, 3) before they were moved.
        mask: (H, W) bool, the person's visible pixels with a scene point.
    """
    way = (points[mask] - before[mask]).norm(dim=-1)
    way = way[way > 0]
    return float(way.quantile(_MOST)) if len(way) >= _MIN_VERTICES else None


def depth_ratio(
    vertices: Tensor, normals: Tensor, outer: Tensor, mask: Tensor, K: Tensor, depth: Tensor
) -> float | None:
    """Compute the median ratio of a depth map to the body's depth at visible vertices; None with too few vertices.

    Args:
        vertices: (V, 3) metres.
        normals: (V, 3) unit, out of the body.
        outer: (V,) bool, False in mouth and eyes.
        mask: (H, W) bool, the person's visible pixels.
        K: (3, 3) px.
        depth: (H, W) metres along z, NaN where unknown.
    """
    uv = project(vertices, K)
    seen = _camera_facing(vertices, normals, outer) & inside_mask(uv, mask)
    column, row = uv[seen].round().long().unbind(-1)
    ratio = depth[row, column] / vertices[seen][:, 2]
    ratio = ratio[torch.isfinite(ratio) & (ratio > 0)]
    return float(ratio.median()) if len(ratio) >= _MIN_VERTICES else None


def _camera_facing(vertices: Tensor, normals: Tensor, outer: Tensor) -> Tensor:
    """Return (V,) bool: True for outer vertices that face the camera and are in front of it."""
    return facing_camera(normals, vertices, _FACING_DEG) & outer & (vertices[:, 2] > 0)
