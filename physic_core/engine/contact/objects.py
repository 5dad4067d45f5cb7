"""Small objects that people hold or have on their laps, and the distances of body vertices to them.

A photo shows only the front of an object. Its depth is inferred from the width of its front: at a
pixel ``r`` metres from the silhouette, of an object of half width ``R``, the object is ``2 sqrt(r
(2 R - r))`` thick, like a ball. Camera frame, metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from physic_core.geometry.camera import project
from physic_core.geometry.pointmap import depth_to_pointmap

# of the median depth: pixels farther from it show what is behind the object
_MAX_DEPTH_SPREAD = 0.15


@dataclass(frozen=True)
class HeldObjects:
    """Small objects in the photo.

    Attributes:
        masks: (K, H, W) bool, visible pixels of each object.
        depth: (H, W) metres along z of the photo, NaN where unknown.
        ratio: (N,) depth of each body over the depth of its pixels in the photo: an object has the
            same distance from its holder as in the photo. A person with NaN touches no object.
        K: (3, 3) px.
    """

    masks: Tensor
    depth: Tensor
    ratio: Tensor
    K: Tensor


@dataclass(frozen=True)
class ObjectDistances:
    """Nearest object of each vertex.

    Attributes:
        distance: (N, V) signed, metres, negative inside; inf if no object is within the search
            radius.
        object: (N, V) int64, index of that object; 0 if there is none.
    """

    distance: Tensor
    object: Tensor


def object_distances(vertices: Tensor, objects: HeldObjects, radius: float) -> ObjectDistances:
    """Find the nearest object of each vertex.

    Args:
        vertices: (N, V, 3) metres.
        objects: of the photo.
        radius: of the search, metres.
    """
    distance = torch.full_like(vertices[..., 0], torch.inf)
    nearest = torch.zeros(distance.shape, dtype=torch.int64, device=vertices.device)
    points = depth_to_pointmap(objects.depth, objects.K)
    for k, mask in enumerate(objects.masks):
        shape = _shape(mask, points, float(objects.K[0, 0]))
        if shape is None:
            continue
        front, thickness = shape
        for i in torch.isfinite(objects.ratio).nonzero()[:, 0].tolist():
            ratio = objects.ratio[i]
            found = _distance_to(vertices[i], front * ratio, thickness * ratio, objects.K, radius)
            closer = found.abs() < distance[i].abs()
            distance[i] = torch.where(closer, found, distance[i])
            nearest[i] = torch.where(closer, k, nearest[i])
    return ObjectDistances(distance, nearest)


def _shape(mask: Tensor, points: Tensor, focal_px: float) -> tuple[Tensor, Tensor] | None:
    """Return the visible points (H, W, 3) of an object, NaN elsewhere, and its thickness (H, W),
    metres along z.
    """
    import cv2

    z = points[..., 2]
    known = mask & torch.isfinite(z) & (z > 0)
    if not bool(known.any()):
        return None
    middle = z[known].median()
    known = known & ((z - middle).abs() < _MAX_DEPTH_SPREAD * middle)
    # One pixel of border, so that the picture's edge counts as a silhouette.
    inside = np.pad(mask.cpu().numpy().astype(np.uint8), 1)
    to_rim = torch.from_numpy(cv2.distanceTransform(inside, cv2.DIST_L2, 5)[1:-1, 1:-1]).to(z)
    depth = to_rim * (middle / focal_px)
    widest = depth.amax()
    thickness = 2 * torch.sqrt((depth * (2 * widest - depth)).clamp(min=0))
    return torch.where(known[..., None], points, torch.nan), thickness


def _distance_to(
    vertices: Tensor, front: Tensor, thickness: Tensor, K: Tensor, radius: float
) -> Tensor:
    """Return the signed distance (V,) of vertices (V, 3) to an object, inf beyond the radius."""
    known = torch.isfinite(front[..., 2])
    ahead = front[known]
    behind = ahead * (1 + thickness[known] / ahead[:, 2])[:, None]
    tree = cKDTree(
        torch.cat([ahead, behind]).cpu().double().numpy(), balanced_tree=False, compact_nodes=False
    )
    apart, _ = tree.query(vertices.cpu().double().numpy(), distance_upper_bound=radius)
    distance = torch.from_numpy(apart).to(vertices)
    height, width = known.shape
    column, row = project(vertices, K).round().unbind(-1)
    inside = (vertices[:, 2] > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    pixel = torch.where(inside, row * width + column, 0.0).long()
    z = vertices[:, 2]
    depth = front[..., 2].flatten()[pixel]
    inside = inside & (z > depth) & (z < depth + thickness.flatten()[pixel])
    return torch.where(inside & torch.isfinite(distance), -distance, distance)
