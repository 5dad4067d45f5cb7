"""Visibility as in the paper's released code: inside the union of all masks, on limbs that ray
casting finds visible.

Vertices inside the masks and camera-facing vertices are found once, with bodies placed by the
keypoints alone (Eq. 2). Hidden limbs are found at each refresh.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from physic_core.body import BodyOutput
from physic_core.engine.joint import (
    HIDDEN_LIMB_SHARE,
    OcclusionTracker,
    Sampling,
    Visibility,
    update_visibility,
)
from physic_core.engine.limbs import limb_part_indices
from physic_core.geometry import RayCaster


def mean_face_normals(vertices: Tensor, faces: Tensor) -> Tensor:
    """Return the unit normals of vertices (..., V, 3) as means of the unit normals of adjacent
    faces.
    """
    a, b, c = (vertices[..., faces[:, k], :] for k in range(3))
    unit = torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=-1)
    total = torch.zeros_like(vertices)
    for k in range(3):
        total = total.index_add(-2, faces[:, k], unit)
    return torch.nn.functional.normalize(total, dim=-1)


def is_opposite_optical_axis(normals: Tensor, max_angle_deg: float) -> Tensor:
    """Return which normals (..., 3) are within an angle of (0, 0, -1), opposite to the optical
    axis: (...) bool.
    """
    return -normals[..., 2] > math.cos(math.radians(max_angle_deg))


def part_shares_without_self_occlusion(
    vertices: Tensor, faces: Tensor, part_of_vertex: Tensor, parts: Sequence[int]
) -> Tensor:
    """Return the share of visible vertices per part, by casting a ray from the camera to each
    vertex.

    A vertex is visible if its ray first hits its own part. Rays along the silhouette may miss the
    mesh; such vertices count as hidden. A share changes by up to 0.05 when all vertices move by a
    micrometre.

    Args:
        vertices: (V, 3) metres, camera frame.
        faces: (F, 3) int64.
        part_of_vertex: (V,) int64.
        parts: P part indices.

    Returns:
        (P,) float64; 1 for a part without vertices.
    """
    points, triangles, part = (
        t.detach().numpy() for t in (vertices.double(), faces, part_of_vertex)
    )
    # Scaled and normalised as trimesh does in the released code: which rays miss depends on the
    # rounding.
    low = points.min(0)
    size = np.linalg.norm(np.ptp(points, axis=0))
    rays = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-9)
    face = RayCaster(100 / size * (points - low), triangles).first_faces(-100 / size * low, rays)
    shows_own_part = (face >= 0) & (part[triangles[face]] == part[:, None]).any(1)
    return torch.tensor(
        [shows_own_part[part == p].mean() if (part == p).any() else 1.0 for p in parts],
        dtype=torch.float64,
    )


def update_released_visibility(
    sampling: Sampling,
    bodies: BodyOutput,
    self_occlusion: OcclusionTracker,
    last: Visibility | None,
) -> Visibility:
    """Compute the visibility of vertices as in the paper's released code.

    The first update (``last`` is None) uses the positions by the keypoints alone.
    """
    state = sampling.state
    model = sampling.state.model
    ids = sampling.ids
    if last is None and state.keypoint_transl is not None:
        shift = (state.keypoint_transl - state.transl)[:, None]
        bodies = replace(bodies, vertices=bodies.vertices + shift, joints=bodies.joints + shift)
    now = update_visibility(sampling, bodies, self_occlusion)
    if last is None:
        in_mask = now.in_mask
        normals = mean_face_normals(bodies.vertices, model.faces)[:, ids]
        facing = is_opposite_optical_axis(normals, sampling.visibility.facing_deg) & in_mask
    else:
        in_mask = last.in_mask
        facing = last.facing
    parts = torch.tensor(limb_part_indices(model.part_names))
    hidden_limbs = torch.zeros_like(in_mask)
    for i, vertices in enumerate(bodies.vertices):
        shares = part_shares_without_self_occlusion(
            vertices, model.faces, model.part_of_vertex, parts.tolist()
        )
        hidden = parts[shares < 1 - HIDDEN_LIMB_SHARE]
        hidden_limbs[i] = torch.isin(model.part_of_vertex[ids], hidden)
    return replace(
        now,
        eligible=sampling.on_visible_part,
        in_mask=in_mask,
        hidden=~in_mask | hidden_limbs,
        facing=facing,
    )
