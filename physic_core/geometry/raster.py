"""Depth buffers of batches of posed bodies.

Camera frame (x right, y down, z forward), metres; the camera is the origin. Triangles are bucketed
by the size of their pixel box, and each bucket is tested as one block. A minimum over (depth, face)
in one integer selects the nearest face, so that results are deterministic.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

_SIDES = (2, 4, 8, 16, 32, 64, 128, 256, 512, 1024)  # px, sides of the pixel boxes of a bucket
_BLOCK_PIXELS = 1 << 24  # pixels per block
_NEAR_M = 1e-3  # triangles with a smaller depth are not drawn


def rasterize(pixels: Tensor, z: Tensor, faces: Tensor, height: int, width: int) -> Tensor:
    """Return the nearest front face at each pixel: (B, height, width) int64, -1 where there is
    none.

    Args:
        pixels: (B, V, 2) px, integers at the pixels' centres.
        z: (B, V) metres along the optical axis.
        faces: (F, 3) int64.
        height: of the image.
        width: of the image.
    """
    batch = len(pixels)
    nothing = torch.iinfo(torch.int64).max
    pictures = torch.full((batch, height, width), nothing, dtype=torch.int64)
    # (B * F, 3, 2), (B * F, 3)
    corner = pixels[:, faces].flatten(0, 1)
    depth = z[:, faces].flatten(0, 1)
    body = torch.arange(batch).repeat_interleave(len(faces))
    name = torch.arange(len(faces)).repeat(batch)
    low = corner.amin(1).ceil().clamp(min=0)
    high = torch.minimum(corner.amax(1).floor(), pixels.new_tensor([width - 1, height - 1]))
    extent = (high - low + 1).amax(1)
    # Image rows go down: a counter-clockwise triangle that faces the camera has a negative area.
    drawn = (_doubled_areas(corner) < 0) & (depth.amin(1) > _NEAR_M) & (low <= high).all(1)
    triangles = _Triangles(corner, depth, low, high, body, name)
    largest = max(height, width)
    least = 0
    for side in (*(s for s in _SIDES if s < largest), largest):
        chosen = (drawn & (extent > least) & (extent <= side)).nonzero(as_tuple=True)[0]
        least = side
        for rows in torch.split(chosen, max(1, _BLOCK_PIXELS // (side * side))):
            _draw(pictures, _Triangles(*(part[rows] for part in triangles)), side)
    return torch.where(pictures == nothing, -1, pictures & 0xFFFFFFFF)


class _Triangles(NamedTuple):
    """Triangles of several bodies, projected to images."""

    corner: Tensor  # (n, 3, 2) px
    depth: Tensor  # (n, 3)
    low: Tensor  # (n, 2) px, first pixel of the box
    high: Tensor  # (n, 2) px, last pixel
    body: Tensor  # (n,) int64, index of the image
    name: Tensor  # (n,) int64, index of the face


def _doubled_areas(corner: Tensor) -> Tensor:
    """Return the signed doubled areas (n,) of triangles (n, 3, 2)."""
    first = corner[:, 1] - corner[:, 0]
    second = corner[:, 2] - corner[:, 0]
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]


def _doubled_parts(corner: Tensor, x: Tensor, y: Tensor) -> list[Tensor]:
    """Return the signed doubled areas (n, H, W) between each pixel of columns x (n, W) and rows y
    (n, H) and the edge opposite to each corner of the triangles (n, 3, 2).
    """
    a, b, c = corner.unbind(1)
    parts = []
    for p, q in ((b, c), (c, a), (a, b)):
        run = q - p
        parts.append(
            run[:, :1, None] * (y - p[:, 1:])[:, :, None]
            - run[:, 1:, None] * (x - p[:, :1])[:, None, :]
        )
    return parts


def _draw(pictures: Tensor, triangles: _Triangles, side: int) -> None:
    """Draw the triangles of one bucket into the depth buffers."""
    corner, depth, low, high, body, name = triangles
    _, height, width = pictures.shape
    steps = torch.arange(side, dtype=corner.dtype)
    x, y = (low[:, k, None] + steps for k in range(2))  # (n, side)
    weights = _doubled_parts(corner, x, y)
    total = weights[0] + weights[1] + weights[2]
    covered = (weights[0] <= 0) & (weights[1] <= 0) & (weights[2] <= 0) & (total < 0)
    covered &= ((x <= high[:, :1])[:, None, :]) & ((y <= high[:, 1:])[:, :, None])
    # 1 / z is linear in the image.
    inverse = sum(w / d[:, None, None] for w, d in zip(weights, depth.unbind(1), strict=True))
    z = (total / inverse)[covered]
    which, row, column = covered.nonzero(as_tuple=True)
    pixel = (
        (body[which] * height + low[which, 1].long() + row) * width + low[which, 0].long() + column
    )
    # Positive floats have the same order as their bit patterns.
    key = (z.float().view(torch.int32).long() << 32) | name[which]
    pictures.view(-1).scatter_reduce_(0, pixel, key, "amin")
