"""What a camera sees of meshes and depths."""

from __future__ import annotations

import numpy as np
import torch

from physic_core.geometry.camera import pixel_rays
from physic_core.geometry.rays import RayCaster
from physic_core.types import Pointmap


def rays_of(camera):
    """Return the direction (H, W, 3) of the ray through each pixel, with z = 1."""
    return pixel_rays(camera.height, camera.width, torch.from_numpy(camera.matrix)).numpy()


def seen(vertices, faces, camera):
    """Return the depth (H, W) of a mesh, inf where no ray meets it, and the face that is met."""
    hits = RayCaster(vertices, faces).first(np.zeros(3), rays_of(camera).reshape(-1, 3))
    size = camera.height, camera.width
    return hits.distance.reshape(size), hits.face.reshape(size)


def pointmap_of(depth, camera, unknown="inverse_scale_shift", **known):
    """Return the point map of a depth (H, W), valid where it is finite."""
    points = np.float32(rays_of(camera) * depth[..., None])
    return Pointmap(points, np.isfinite(depth), unknown, camera, **known)
