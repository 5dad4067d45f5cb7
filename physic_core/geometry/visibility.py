"""Visibility of body vertices in the photo: facing angle, masks, and occlusion by limbs or other people.

Camera frame (x right, y down, z forward), metres; the camera is the origin. Pixels have integer centres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
import torch.nn.functional as F

from physic_core.geometry.raster import hidden_by_raster
from physic_core.geometry.rays import RayCaster

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor

    from physic_core.geometry.coarse_mesh import CoarseMesh

_BEHIND_M = 2e-3  # least distance of a surface in front of a vertex that hides it; a smaller gap is rounding error


def facing_camera(normals: Tensor, vertices: Tensor, max_angle_deg: float) -> Tensor:
    """Return whether vertex normals are within an angle of the direction to the camera (paper sec. 3.2): (...) bool.

    Args:
        normals: (..., 3) unit.
        vertices: (..., 3) metres, camera frame.
        max_angle_deg: largest angle; 90 takes all vertices that face the camera.
    """
    towards = -F.normalize(vertices, dim=-1)
    return (normals * towards).sum(-1) > math.cos(math.radians(max_angle_deg))


def inside_image(uv: Tensor, height: int, width: int) -> Tensor:
    """Return whether pixel coordinates (..., 2) round to a pixel of the image; False for NaN: (...) bool."""
    u, v = uv[..., 0], uv[..., 1]
    return (u >= -0.5) & (u < width - 0.5) & (v >= -0.5) & (v < height - 0.5)


def inside_mask(uv: Tensor, mask: Tensor) -> Tensor:
    """Return whether the mask is set at pixel coordinates; False outside the image: (..., V) bool.

    Args:
        uv: (..., V, 2) px.
        mask: (..., H, W) bool, with the leading dimensions of ``uv``.
    """
    height, width = mask.shape[-2:]
    inside = inside_image(uv, height, width)
    safe = torch.where(inside[..., None], uv, torch.zeros_like(uv)).round().long()
    flat = safe[..., 1] * width + safe[..., 0]
    return torch.gather(mask.flatten(-2), -1, flat) & inside


def hidden_from_camera(vertices: Tensor, faces: Tensor) -> tuple[Tensor, Tensor]:
    """Return which vertices are behind another face of their own mesh.

    By ray casts on the CPU, and by rasterisation on CUDA.

    Args:
        vertices: (..., V, 3) metres, camera frame.
        faces: (F, 3) int64, of a closed surface, counter-clockwise seen from outside.

    Returns:
        hidden: (..., V) bool.
        face: (..., V) int64, the face in front of a hidden vertex; -1 for the others.
    """
    shape = vertices.shape[:-1]
    bodies = vertices.detach().reshape(-1, *vertices.shape[-2:])
    if vertices.is_cuda:
        hidden, face = hidden_by_raster(bodies, faces)
        return hidden.reshape(shape), face.reshape(shape)
    triangles = faces.cpu().numpy()
    pairs = [_cast_rays(body.cpu().double().numpy(), triangles) for body in bodies]
    hidden, face = (torch.from_numpy(np.stack(part)).to(vertices.device) for part in zip(*pairs, strict=True))
    return hidden.reshape(shape), face.reshape(shape)


def _cast_rays(
    points: NDArray[np.float64], triangles: NDArray[np.int64]
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    distance = np.linalg.norm(points, axis=1)
    rays = points / np.maximum(distance, 1e-9)[:, None]
    # Only faces that face the camera can be hit first: the others are excluded from the search tree.
    start = points[triangles[:, 0]]
    normals = np.cross(points[triangles[:, 1]] - start, points[triangles[:, 2]] - start)
    front = np.flatnonzero((normals * start).sum(1) < 0)
    if not len(front):
        return np.zeros(len(points), bool), np.full(len(points), -1)
    caster = RayCaster(points, triangles[front])
    hit = caster.first_faces(np.zeros(3), rays)
    nearer = caster.plane_distance(hit, np.zeros_like(rays), rays)
    face = front[hit]
    own = (triangles[face] == np.arange(len(points))[:, None]).any(1)
    hidden = (hit >= 0) & ~own & (nearer < distance - _BEHIND_M)
    return hidden, np.where(hidden, face, -1)


@dataclass(frozen=True)
class SelfOcclusion:
    """Self-occlusion of people: occluded vertices (..., V) and occluded body parts (..., P).

    Attributes:
        hidden: (..., V) bool, vertices behind any face of the same body.
        by_other_part: (..., V) bool, vertices behind a face of another part.
        parts: (..., P) bool, occluded parts.
        vertices: (..., V) bool, all vertices of those parts.
    """

    hidden: Tensor
    by_other_part: Tensor
    parts: Tensor
    vertices: Tensor


def self_occlusion(
    vertices: Tensor,
    faces: Tensor,
    part_of_vertex: Tensor,
    parts: Sequence[int],
    share: float = 0.3,
    coarse: CoarseMesh | None = None,
) -> SelfOcclusion:
    """Find body parts that other parts of the same body hide from the camera (paper sec. 3.3).

    Args:
        vertices: (..., V, 3) metres, camera frame.
        faces: (F, 3) int64, of a closed surface.
        part_of_vertex: (V,) int64.
        parts: parts that can become occluded; the paper and its code take the limbs, not trunk and head.
        share: least share of a part's vertices hidden by other parts.
        coarse: simplified mesh of the same body; its vertices are tested instead, several times as fast.
    """
    if coarse is None:
        hidden, face = hidden_from_camera(vertices, faces)
        in_front = part_of_vertex[faces[face.clamp(min=0), 0]]
    else:
        hidden, face = hidden_from_camera(vertices.index_select(-2, coarse.ids), coarse.faces)
        in_front = part_of_vertex[coarse.ids[coarse.faces[face.clamp(min=0), 0]]]
        hidden, in_front = (flags.index_select(-1, coarse.of_vertex) for flags in (hidden, in_front))
    by_other = hidden & (in_front != part_of_vertex)
    count = max(int(part_of_vertex.max()) + 1, max(parts, default=-1) + 1)
    total = torch.bincount(part_of_vertex, minlength=count)
    lost = total.new_zeros(*by_other.shape[:-1], count).index_add(-1, part_of_vertex, by_other.to(total.dtype))
    eligible = torch.zeros(count, dtype=torch.bool, device=vertices.device)
    eligible[list(parts)] = True
    occluded = eligible & (lost >= share * total) & (total > 0)
    return SelfOcclusion(hidden, by_other, occluded, occluded[..., part_of_vertex])
