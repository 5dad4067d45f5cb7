"""The terms of the joint energy (paper Eq. 2, 4, 6, 7 and sec. 3.3), each a pure function with one value per person.

Camera frame (x right, y down, z forward), metres and pixels. B people, V vertices, J keypoints. A term is a weighted
sum of robust squared residuals; which of them count (visible, near, active) comes in as a weight, so that every term
is smooth in what it is given. ``rho`` maps squared residuals to a robust loss.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX

__all__ = [
    "LEAST_DEPTH_M",
    "Rho",
    "balance",
    "chamfer",
    "contact",
    "depth_at_pixels",
    "hinge_angles",
    "joint_limits",
    "lowest_height",
    "lowest_rows",
    "mesh_deviation",
    "penetration",
    "penetration_by_points",
    "plane_height",
    "prior",
    "reprojection",
    "root_relative",
    "signed_distance",
    "soles",
    "sum_of_axes",
]

Rho = Callable[[Tensor], Tensor]

# Left and right are neighbours among the joints, and a slice is a view where a list of two is a copy.
_KNEES, _ANKLES, _TOES, _ELBOWS = (
    slice(JOINT_INDEX[f"left_{name}"], JOINT_INDEX[f"right_{name}"] + 1) for name in ("knee", "ankle", "foot", "elbow")
)

LEAST_DEPTH_M = 0.01  # of a vertex before the camera
_LOWEST_SHARE = 0.05  # of a sole's vertices: on tiptoe no more than this touches
_MAX_FLEXION = 2.7  # radians; a knee or an elbow bends no further
_LIMIT_SIGMA = 1.0 / 12.0  # radians, about 5 degrees
_STANDING_POINT = 0.35  # where, from the ankles to the balls of the feet, a quiet stander's mass is
_BALANCE_SLACK = 0.05  # metres round that point that are as good
_BALANCE_SIGMA = 0.04  # metres beyond


def reprojection(
    projected: Tensor,
    observed: Tensor,
    weight: Tensor,
    unit: Tensor,
    rho: Rho,
    *,
    per_axis: bool = False,
) -> Tensor:
    """L_j2d (Eq. 2): ``sum_j w_j rho(|(pi(J_j) - J^_j) / unit|^2)``.

    Args:
        projected: (B, J, 2) px.
        observed: (B, J, 2) px, finite.
        weight: (B, J) confidence, 0 for what was not seen.
        unit: (B, 1 or 2) px that an error of 1 stands for: a share of the person, or the image's width and height.
        rho: robust loss.
        per_axis: the robust loss takes each axis by itself.

    Returns:
        (B,).
    """
    error = (projected - observed) / unit[:, None]
    squared = error.square()
    loss = rho(squared).sum(-1) if per_axis else rho(squared.sum(-1))
    return (weight * loss).sum(-1)


def depth_at_pixels(
    z: Tensor, log_seen: Tensor, weight: Tensor, log_scale: Tensor, offset: Tensor, sigma: float, rho: Rho
) -> Tensor:
    """L_d (Eq. 4) by pixel: ``mean_v rho((log z_v - log(s d_v) - o)^2 / sigma^2)``, the same at every resolution.

    Args:
        z: (B, V) depth of the vertices, metres.
        log_seen: (B, V) logarithm of the depth map at their pixels, finite.
        weight: (B, V), 0 for vertices that the depth map does not show.
        log_scale: () of the scene, with which the depth map scales.
        offset: (B,) logarithm of how much farther than the scene the map sees the person.
        sigma: expected difference of the logarithms.
        rho: robust loss.

    Returns:
        (B,); 0 for a person without such vertices.
    """
    residual = (z.clamp(min=LEAST_DEPTH_M).log() - log_seen - log_scale - offset[:, None]) / sigma
    total = (weight * rho(residual.square())).sum(-1)
    return total / weight.sum(-1).clamp(min=1e-9)


def chamfer(
    vertices: Tensor, points: Tensor, nearest_point: Tensor, nearest_vertex: Tensor, point_weight: float
) -> Tensor:
    """L_d (Eq. 4) of one person: ``sum_v min_p |v - p|^2 + sum_p min_v |p - v|^2``.

    Args:
        vertices: (n, 3) camera-facing vertices, metres.
        points: (m, 3) human points in the scaled scene, metres.
        nearest_point: (n,) int64, of each vertex.
        nearest_vertex: (m,) int64, of each point.
        point_weight: how many of the original points each stands for.

    Returns:
        () square metres.
    """
    to_points = (vertices - points[nearest_point]).square().sum()
    to_vertices = (points - vertices[nearest_vertex]).square().sum()
    return to_points + point_weight * to_vertices


def signed_distance(vertices: Tensor, points: Tensor, normals: Tensor) -> Tensor:
    """Distance to the plane through each vertex's scene point: ``n_p . (v - p)``, negative inside.

    Args:
        vertices: (..., 3) metres.
        points: (..., 3) metres.
        normals: (..., 3) unit, towards the camera's side.
    """
    return (normals * (vertices - points)).sum(-1)


def plane_height(vertices: Tensor, normal: Tensor, offset: Tensor) -> Tensor:
    """Height over the floor, ``n . v + offset``: (..., 3) -> (...) metres, negative below."""
    return vertices @ normal + offset


def contact(squared: Tensor, weight: Tensor, rho: Rho) -> Tensor:
    """L_c (Eq. 6): ``sum_v w_v rho(d_v^2)``, on either side of the surface.

    Args:
        squared: (B, V) squared distance to the scene or the floor, in units of its expected error.
        weight: (B, V): contact vertices that are near something; 0 for the others.
        rho: robust loss, redescending where far contacts should let go.

    Returns:
        (B,).
    """
    return (weight * rho(squared)).sum(-1)


def penetration(signed: Tensor, weight: Tensor, slack: float, sigma: float, rho: Rho) -> Tensor:
    """L_i (Eq. 7) by signed distance: ``sum_v w_v rho(max(0, -d_v - slack)^2 / sigma^2)``.

    Args:
        signed: (B, V) metres, negative inside.
        weight: (B, V), 0 for vertices that are hidden, unobserved, or near nothing.
        slack: depth that is not punished, metres.
        sigma: expected error of the surface, metres.
        rho: robust loss.

    Returns:
        (B,).
    """
    depth = torch.relu(-signed - slack) / sigma
    return (weight * rho(depth.square())).sum(-1)


def penetration_by_points(squared: Tensor, signed: Tensor, weight: Tensor, rho: Rho) -> Tensor:
    """L_i (Eq. 7) as printed: ``sum_v w_v rho(|v - p|^2) [n_p . (v - p) < 0]``, (B, V) each -> (B,)."""
    return (weight * (signed < 0) * rho(squared)).sum(-1)


def sum_of_axes(rho: Rho, squared: Tensor) -> Tensor:
    """``rho`` of each axis by itself, summed: (..., A) -> (...)."""
    return rho(squared).sum(-1)


def lowest_rows(height: Tensor) -> Tensor:
    """The lowest twentieth of a sole's vertices: (B, n) metres -> (B, n / 20) int64."""
    count = max(1, round(_LOWEST_SHARE * height.shape[-1]))
    return height.topk(count, dim=-1, largest=False).indices


def lowest_height(height: Tensor) -> Tensor:
    """Their mean height: (B, n) -> (B,) metres."""
    return height.gather(-1, lowest_rows(height)).mean(-1)


def soles(lowest: Tensor, weight: Tensor, lower_weight: Tensor, near: Rho, far: Rho) -> Tensor:
    """Soles on the floor: ``sum_f w_f near(h_f^2) + w far(min_f h_f^2)``.

    ``near`` redescends within centimetres, so that a foot in the air stays there; ``far`` does not, and pulls the
    lower foot alone: somebody who stands, walks or runs has at most one foot far from the ground.

    Args:
        lowest: (B, 2) height of the left and the right sole, metres.
        weight: (B, 2), 0 for a foot that was not seen.
        lower_weight: (B,), 0 for who may float (feet not seen, or known to touch nothing).
        near: robust loss of squared metres.
        far: robust loss of squared metres.

    Returns:
        (B,).
    """
    seen = weight > 0
    lower = torch.where(seen, lowest, torch.full_like(lowest, torch.inf)).amin(-1)
    # Unseen feet may be anywhere, infinitely far too: out before their weight of 0 makes them not-a-number.
    lower = torch.where(seen.any(-1), lower, torch.zeros_like(lower))
    lowest = torch.where(seen, lowest, torch.zeros_like(lowest))
    return (weight * near(lowest.square())).sum(-1) + lower_weight * far(lower.square())


def root_relative(vertices: Tensor, pelvis: Tensor, root: Tensor) -> Tensor:
    """Vertices without translation and root rotation, ``R^T (v - pelvis)``.

    Args:
        vertices: (B, V, 3) metres.
        pelvis: (B, 3) metres.
        root: (B, 3, 3).
    """
    return (vertices - pelvis[:, None]) @ root


def mesh_deviation(relative: Tensor, start: Tensor, weight: Tensor) -> Tensor:
    """L_reg of the mesh: ``sum_v w_v |v - v0|^2`` in the root's frame.

    Args:
        relative: (B, V, 3) from :func:`root_relative`, metres.
        start: (B, V, 3) the same at the start.
        weight: (B, V) higher for what the photo does not show, never zero for what it does.

    Returns:
        (B,).
    """
    return (weight * (relative - start).square().sum(-1)).sum(-1)


def prior(deviation: Tensor, weight: Tensor) -> Tensor:
    """L_reg of the parameters, whitened or raw: ``sum_i w_i x_i^2``, (B, P) and (P,) -> (B,)."""
    return deviation.square() @ weight


def hinge_angles(rotations: Tensor) -> Tensor:
    """Flexion of left knee, right knee, left elbow, right elbow: (B, 55, 3, 3) -> (B, 4) radians, 0 straight.

    Knees bend about x, elbows about y (left the other way round); twist about the limb's own axis does not count.
    """
    knee, elbow = rotations[:, _KNEES], rotations[:, _ELBOWS]
    bend = torch.atan2(-elbow[..., 2, 0], elbow[..., 0, 0])
    return torch.cat([torch.atan2(knee[..., 2, 1], knee[..., 1, 1]), -bend[:, :1], bend[:, 1:]], 1)


def joint_limits(rotations: Tensor) -> Tensor:
    """One-sided limits: ``sum_h (max(0, -a_h)^2 + max(0, a_h - 2.7)^2) / sigma^2`` over knees and elbows. (B,)."""
    angle = hinge_angles(rotations)
    beyond = torch.relu(-angle) + torch.relu(angle - _MAX_FLEXION)
    return (beyond / _LIMIT_SIGMA).square().sum(-1)


def balance(mass: Tensor, joints: Tensor, up: Tensor, weight: Tensor, rho: Rho) -> Tensor:
    """Centre of mass over the feet along the viewing direction: ``w rho(max(0, |(m - f) . d| - 5 cm)^2 / sigma^2)``.

    A single photo shows sideways balance by itself; leaning towards or away from the camera it cannot show.

    Args:
        mass: (B, 3) centre of mass, metres.
        joints: (B, 55, 3) metres.
        up: (3,) unit normal of the floor.
        weight: (B,), 0 for who does not stand.
        rho: robust loss.

    Returns:
        (B,).
    """
    ankles, toes = joints[:, _ANKLES].mean(1), joints[:, _TOES].mean(1)
    feet = ankles + _STANDING_POINT * (toes - ankles)
    forward = torch.stack([torch.zeros_like(up[0]), torch.zeros_like(up[0]), torch.ones_like(up[0])])
    level = forward - (forward @ up) * up
    # A camera that looks straight down has no level viewing direction: the term then vanishes with it.
    level = level / level.norm().clamp(min=0.1)
    lean = torch.relu(((mass - feet) @ level).abs() - _BALANCE_SLACK) / _BALANCE_SIGMA
    return weight * rho(lean.square())
