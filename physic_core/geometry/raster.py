"""Depth buffers of posed bodies on any device: which face the camera sees, for a whole batch at once.

Camera frame (x right, y down, z forward), metres; the camera is the origin. What rays decide exactly on the CPU
(:mod:`physic_core.geometry.visibility`) this decides by the pixel, without leaving the device. Triangles are bucketed
by the size of their box of pixels, each bucket is tested as one block, and the nearest face of a pixel wins by a
minimum over (depth, face) in one integer: the order of the work changes nothing, so that results repeat bit by bit.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

__all__ = ["hidden_by_raster", "rasterise"]

_SIDES = (2, 4, 8, 16, 32, 64, 128, 256, 512, 1024)  # px, of the boxes of a bucket
_BLOCK = 1 << 24  # pixels that are tested at once
_NEAR_M = 1e-3  # a triangle that reaches nearer to the camera's plane is left out
_BEHIND_M = 2e-3  # as for rays: less is the vertex's own surface, rounded


def hidden_by_raster(vertices: Tensor, faces: Tensor, size: int = 1024) -> tuple[Tensor, Tensor]:
    """Which vertices lie behind another face of their own mesh.

    Each body is drawn as large as ``size`` allows. At a vertex the plane of the face that won its pixel is evaluated
    on the vertex's own ray, so that a slanted surface does not hide itself.

    Args:
        vertices: (B, V, 3) metres, camera frame.
        faces: (F, 3) int64, of a closed surface, counter-clockwise seen from outside.
        size: side of the pictures, px.

    Returns:
        hidden: (B, V) bool.
        face: (B, V) int64, the face in front of a hidden vertex; -1 for the others.
    """
    batch, count = vertices.shape[:2]
    pixels = _fit(vertices, size)
    seen = rasterise(pixels, vertices[..., 2], faces, size, size)
    # Where a body is not in front of the camera, its pixels mean nothing.
    inside = ((pixels >= 0) & (pixels <= size - 1)).all(-1) & (vertices[..., 2] > _NEAR_M)
    at = torch.where(inside[..., None], pixels, torch.zeros_like(pixels)).round().long()
    face = seen.view(batch, -1).gather(1, at[..., 1] * size + at[..., 0])
    corners = faces[face.clamp(min=0)]
    rows = torch.arange(batch, device=vertices.device)[:, None]
    a, b, c = (vertices[rows, corners[..., k]] for k in range(3))
    normal = torch.linalg.cross(b - a, c - a)
    along = (normal * vertices).sum(-1)
    # The share of the way to the vertex at which its ray meets that plane.
    share = torch.where(along.abs() > 1e-12, (normal * a).sum(-1) / along, torch.full_like(along, torch.inf))
    own = (corners == torch.arange(count, device=vertices.device)[:, None]).any(-1)
    gap = (1 - share) * vertices.norm(dim=-1)
    hidden = inside & (face >= 0) & ~own & (gap > _BEHIND_M)
    return hidden, torch.where(hidden, face, torch.full_like(face, -1))


def rasterise(pixels: Tensor, z: Tensor, faces: Tensor, height: int, width: int) -> Tensor:
    """The nearest face at each pixel, of faces that turn their front to the camera.

    Args:
        pixels: (B, V, 2) px, integers at the pixels' centres.
        z: (B, V) metres along the optical axis.
        faces: (F, 3) int64.
        height: of the picture.
        width: of the picture.

    Returns:
        (B, height, width) int64, -1 where there is none.
    """
    batch, device = len(pixels), pixels.device
    nothing = torch.iinfo(torch.int64).max
    pictures = torch.full((batch, height, width), nothing, dtype=torch.int64, device=device)
    corner, depth = pixels[:, faces].flatten(0, 1), z[:, faces].flatten(0, 1)  # (B * F, 3, 2), (B * F, 3)
    body = torch.arange(batch, device=device).repeat_interleave(len(faces))
    name = torch.arange(len(faces), device=device).repeat(batch)
    edge1, edge2 = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    doubled = edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0]
    low = corner.amin(1).ceil().clamp(min=0)
    high = torch.minimum(corner.amax(1).floor(), pixels.new_tensor([width - 1, height - 1]))
    extent = (high - low + 1).amax(1)
    # Rows of a picture go down: seen from its front, a counter-clockwise triangle has a negative area here.
    drawn = (doubled < 0) & (depth.amin(1) > _NEAR_M) & (low <= high).all(1)
    triangles = _Triangles(corner, depth, low, high, body, name)
    least = 0
    for side in _sides(max(height, width)):
        chosen = (drawn & (extent > least) & (extent <= side)).nonzero(as_tuple=True)[0]
        least = side
        for rows in torch.split(chosen, max(1, _BLOCK // (side * side))):
            _draw(pictures, _Triangles(*(part[rows] for part in triangles)), side)
    return torch.where(pictures == nothing, torch.full_like(pictures, -1), pictures & 0xFFFFFFFF)


class _Triangles(NamedTuple):
    """n triangles in the pictures of several bodies."""

    corner: Tensor  # (n, 3, 2) px
    depth: Tensor  # (n, 3)
    low: Tensor  # (n, 2) px, first pixel of their boxes
    high: Tensor  # (n, 2) px, last pixel
    body: Tensor  # (n,) int64, whose picture
    name: Tensor  # (n,) int64, of the face


def _draw(pictures: Tensor, triangles: _Triangles, side: int) -> None:
    """Triangles of one bucket: every pixel of a square of ``side`` from ``low``, against the three edges."""
    corner, depth, low, high, body, name = triangles
    _, height, width = pictures.shape
    steps = torch.arange(side, device=corner.device, dtype=corner.dtype)
    x, y = (low[:, k, None] + steps for k in range(2))  # (n, side)
    a, b, c = corner.unbind(1)
    weights = []
    for p, q in ((b, c), (c, a), (a, b)):
        run = q - p
        weights.append(run[:, :1, None] * (y - p[:, 1:])[:, :, None] - run[:, 1:, None] * (x - p[:, :1])[:, None, :])
    total = weights[0] + weights[1] + weights[2]
    covered = (weights[0] <= 0) & (weights[1] <= 0) & (weights[2] <= 0) & (total < 0)
    covered &= ((x <= high[:, :1])[:, None, :]) & ((y <= high[:, 1:])[:, :, None])
    # 1 / z is linear in the picture.
    inverse = sum(w / d[:, None, None] for w, d in zip(weights, depth.unbind(1), strict=True))
    z = (total / inverse)[covered]
    which, row, column = covered.nonzero(as_tuple=True)
    pixel = (body[which] * height + low[which, 1].long() + row) * width + low[which, 0].long() + column
    # Bits of positive floats are in the order of the numbers.
    key = (z.float().view(torch.int32).long() << 32) | name[which]
    pictures.view(-1).scatter_reduce_(0, pixel, key, "amin")


def _fit(vertices: Tensor, size: int) -> Tensor:
    """Pixels (B, V, 2) of each body, seen from the camera and stretched to fill a square picture."""
    flat = vertices[..., :2] / vertices[..., 2:].clamp(min=_NEAR_M)
    low, high = flat.amin(1, keepdim=True), flat.amax(1, keepdim=True)
    scale = (size - 1) / (high - low).amax(-1, keepdim=True).clamp(min=1e-9)
    return (flat - low) * scale


def _sides(largest: int) -> list[int]:
    """Sides of buckets up to the one that holds the whole picture."""
    sides = [s for s in _SIDES if s < largest]
    return [*sides, largest]
