"""Point maps: a 3D point for each pixel of the image grid, OpenCV camera frame (x right, y down, z
forward).
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physic_core.errors import BackendOutputError
from physic_core.geometry.camera import pixel_grid, unproject

EDGE_RATIO = 1.05
"""Largest depth ratio within 3 x 3 pixels that is not a depth edge, for an image of 1024 px."""
_REFERENCE_SIDE = 1024
_FEWEST_POINTS = 16
_RINGS = (2, 4)  # px, distances of neighbours of an isolated pixel
_STRIP_ROWS = 64  # of a photo, so that temporary arrays stay in the cache of a CPU


def depth_to_pointmap(depth: Tensor, K: Tensor) -> Tensor:
    """Unproject a depth map to a point map.

    Args:
        depth: (..., H, W) along z, any unit; NaN stays NaN.
        K: (3, 3) px.

    Returns:
        (..., H, W, 3), the unit of ``depth``.
    """
    height, width = depth.shape[-2:]
    return unproject(pixel_grid(height, width, depth), depth, K)


def edge_ratio(rows: int, columns: int) -> float:
    """Return the threshold of the depth ratio at an edge: ``EDGE_RATIO`` for an image side of 1024
    px, otherwise scaled.

    The threshold is at most ``EDGE_RATIO`` squared, since edges are sharp in small images too.
    """
    power: float = min(2.0, _REFERENCE_SIDE / max(rows, columns, 1))
    return math.pow(EDGE_RATIO, power)


def depth_edges(depth: Tensor, valid: Tensor, ratio: float) -> Tensor:
    """Return pixels at depth edges: the depth ratio within 3 x 3 pixels exceeds ``ratio``.

    Depth networks place points between the two surfaces of an edge.

    Args:
        depth: (H, W) > 0 where valid, any unit.
        valid: (H, W) bool; invalid pixels are ignored.
        ratio: above 1.

    Returns:
        (H, W) bool, only among valid pixels.
    """
    far = _max3x3(torch.where(valid, depth, depth.new_zeros(())))
    near = -_max3x3(torch.where(valid, -depth, depth.new_full((), -math.inf)))
    return valid & (far > ratio * near)


def _max3x3(x: Tensor) -> Tensor:
    """Return the maximum over 3 x 3 pixels, by rows then columns."""
    for dim in (0, 1):
        n = x.shape[dim]
        out = x.clone()
        if n > 1:
            ahead = x.narrow(dim, 1, n - 1)
            behind = x.narrow(dim, 0, n - 1)
            torch.maximum(out.narrow(dim, 0, n - 1), ahead, out=out.narrow(dim, 0, n - 1))
            torch.maximum(out.narrow(dim, 1, n - 1), behind, out=out.narrow(dim, 1, n - 1))
        x = out
    return x


def pointmap_normals(points: Tensor, valid: Tensor, ratio: float = 1.05) -> Tensor:
    """Return unit normals that face the camera, from differences of neighbouring pixels (section
    3.1 of the paper).

    Differences across a depth edge are not used. A plane gets its exact normal up to its border.

    Args:
        points: (H, W, 3), any unit.
        valid: (H, W) bool.
        ratio: depth ratio of an edge, see :func:`depth_edges`.

    Returns:
        (H, W, 3), zero where a pixel has no usable neighbour along both image axes.
    """
    height = len(points)
    normals = torch.empty_like(points, memory_format=torch.contiguous_format)
    for top in range(0, height, _STRIP_ROWS):
        first = max(top - 1, 0)
        bottom = min(top + _STRIP_ROWS, height)
        part = _normals(points[first : bottom + 1], valid[first : bottom + 1], ratio)
        normals[top:bottom] = part[top - first : bottom - first]
    return normals


def _normals(points: Tensor, valid: Tensor, ratio: float) -> Tensor:
    """Return :func:`pointmap_normals` of a strip; those of its first and last row lack the
    neighbours outside of it.
    """
    dtype = points.dtype
    # By planes of coordinates: reductions over a last axis of three take twice as long. The last
    # digits of float32 differ from CPU to CPU.
    x, y, z = planes = points.movedim(-1, 0).to(
        torch.float64, memory_format=torch.contiguous_format
    )
    # Two steps of one pixel span the 3 x 3 window.
    limit = math.sqrt(ratio)
    across, has_across = _tangent(planes, valid, 2, limit)
    down, has_down = _tangent(planes, valid, 1, limit)
    normal = torch.linalg.cross(across, down, dim=0)
    u, v, w = normal
    length = torch.sqrt(u * u + v * v + w * w)
    facing = -torch.sign(u * x + v * y + w * z)
    reliable = has_across & has_down & (length > 0) & (facing != 0)
    factor = torch.where(reliable, facing / length.clamp(min=torch.finfo(length.dtype).tiny), 0.0)
    return torch.where(reliable, normal * factor, 0.0).to(dtype).movedim(0, -1).contiguous()


def _tangent(planes: Tensor, valid: Tensor, dim: int, limit: float) -> tuple[Tensor, Tensor]:
    """Return the sum of the usable differences along an image axis, over depth, and whether there
    is any.

    Args:
        planes: (3, h, W) coordinates.
        valid: (h, W) bool.
        dim: 1 or 2, of the coordinates.
        limit: depth ratio of neighbours.
    """
    n = planes.shape[dim]
    tangent = torch.zeros_like(planes)
    has = torch.zeros_like(valid)
    if n < 2:
        return tangent, has
    near = planes.narrow(dim, 0, n - 1)
    far = planes.narrow(dim, 1, n - 1)
    z_near = near[2]
    z_far = far[2]
    usable = valid.narrow(dim - 1, 0, n - 1) & valid.narrow(dim - 1, 1, n - 1)
    usable = usable & (z_far <= limit * z_near) & (z_near <= limit * z_far)
    # Over the depth, so that the cross product neither under- nor overflows in any unit.
    step = torch.where(usable, (far - near) / z_near, 0.0)
    tangent.narrow(dim, 0, n - 1).add_(step)
    tangent.narrow(dim, 1, n - 1).add_(step)
    has.narrow(dim - 1, 0, n - 1).logical_or_(usable)
    has.narrow(dim - 1, 1, n - 1).logical_or_(usable)
    return tangent, has


def isolated_pixels(depth: Tensor, valid: Tensor, ratio: float) -> Tensor:
    """Return pixels with fewer than two of eight neighbours at a similar depth, 2 px or 4 px apart.

    A fast substitute for the paper's k-nearest-neighbour outlier rule that keeps distant points and
    thin poles.

    Args:
        depth: (H, W) > 0 where valid, any unit.
        valid: (H, W) bool; invalid pixels do not count as neighbours.
        ratio: largest depth ratio of similar neighbours two pixels apart; it grows with the
            distance.

    Returns:
        (H, W) bool, only among valid pixels.
    """
    height, width = depth.shape
    log_depth = torch.where(valid, depth, depth.new_ones(())).log()
    lonely = torch.zeros_like(valid)
    for ring in _RINGS:
        tolerance = 0.5 * ring * math.log(ratio)
        support = torch.zeros_like(valid, dtype=torch.uint8)
        for dy, dx in ((0, ring), (ring, 0), (ring, ring), (ring, -ring)):
            rows = height - dy
            columns = width - abs(dx)
            if rows <= 0 or columns <= 0:
                continue
            left = max(0, -dx)
            right = max(0, dx)
            pixel = (slice(0, rows), slice(left, left + columns))
            neighbor = (slice(dy, dy + rows), slice(right, right + columns))
            alike = (log_depth[pixel] - log_depth[neighbor]).abs_() <= tolerance
            alike &= valid[pixel] & valid[neighbor]
            support[pixel] += alike
            support[neighbor] += alike
        lonely |= support < 2
    return valid & lonely


def intrinsics_from_pointmap(points: Tensor, valid: Tensor) -> tuple[float, float, float, float]:
    """Estimate the intrinsics of a point map (paper Sec. 3.1, "Combined scene points").

    The principal point is the image centre; the focal lengths are medians of (u - cx) Z / X and (v
    - cy) Z / Y.

    Args:
        points: (H, W, 3), any unit.
        valid: (H, W) bool.

    Returns:
        fx, fy, cx, cy in px.

    Raises:
        BackendOutputError: there are too few valid points, or a focal length is not positive.
    """
    height, width = valid.shape
    cx = (width - 1) / 2
    cy = (height - 1) / 2
    offset = pixel_grid(height, width, points) - points.new_tensor([cx, cy])
    usable = valid[..., None] & (points[..., :2] != 0) & (offset != 0)
    focal = []
    for axis, name in ((0, "X"), (1, "Y")):
        chosen = usable[..., axis]
        ratio = (offset[..., axis] * points[..., 2] / points[..., axis])[chosen]
        if len(ratio) < _FEWEST_POINTS:
            raise BackendOutputError(
                f"cannot estimate the focal length from the point map: {len(ratio)} valid points "
                f"have {name} != 0, {_FEWEST_POINTS} are needed: give the camera, or check the "
                "backend's valid mask"
            )
        focal.append(float(ratio.median()))
    if min(focal) <= 0:
        raise BackendOutputError(
            "cannot estimate the focal length from the point map: medians are "
            f"fx = {focal[0]:.1f}, fy = {focal[1]:.1f} px, both must be "
            "positive: points must be in the OpenCV camera frame, x right, y down, z forward"
        )
    return focal[0], focal[1], cx, cy
