"""Distances and angles that several terms share: to planes, of soles, of knees and elbows. Camera frame, metres."""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX

__all__ = ["hinge_angles", "lowest_height", "lowest_rows", "plane_height", "root_relative", "signed_distance"]

# Left and right joints are adjacent: a slice gives a view, a list of indices a copy.
_KNEES, _ELBOWS = (slice(JOINT_INDEX[f"left_{name}"], JOINT_INDEX[f"right_{name}"] + 1) for name in ("knee", "elbow"))
_LOWEST_SHARE = 0.05  # of a sole's vertices: on tiptoe only this share touches the floor


def signed_distance(vertices: Tensor, points: Tensor, normals: Tensor) -> Tensor:
    """Distance of vertices to the planes through their scene points: ``n_p . (v - p)``, negative inside.

    Args:
        vertices: (..., 3) metres.
        points: (..., 3) metres.
        normals: (..., 3) unit, towards the camera's side.

    Returns:
        (...) metres.
    """
    return (normals * (vertices - points)).sum(-1)


def plane_height(vertices: Tensor, normal: Tensor, offset: Tensor) -> Tensor:
    """Height over the floor, ``n . v + offset``: (..., 3) -> (...) metres, negative below."""
    return vertices @ normal + offset


def lowest_rows(height: Tensor) -> Tensor:
    """Rows of the lowest twentieth of a sole's vertices: heights (B, n) metres -> (B, n / 20) int64."""
    count = max(1, round(_LOWEST_SHARE * height.shape[-1]))
    return height.topk(count, dim=-1, largest=False).indices


def lowest_height(height: Tensor) -> Tensor:
    """Mean height of the lowest twentieth of a sole's vertices: (B, n) -> (B,) metres."""
    return height.gather(-1, lowest_rows(height)).mean(-1)


def root_relative(vertices: Tensor, pelvis: Tensor, root: Tensor) -> Tensor:
    """Vertices without translation and root rotation, ``R^T (v - pelvis)``.

    Args:
        vertices: (B, V, 3) metres.
        pelvis: (B, 3) metres.
        root: (B, 3, 3).
    """
    return (vertices - pelvis[:, None]) @ root


def hinge_angles(rotations: Tensor) -> Tensor:
    """Flexion of left knee, right knee, left elbow, right elbow: (B, 55, 3, 3) -> (B, 4) radians, 0 straight.

    Knees bend about x, elbows about y (left the other way round); twist about the limb's own axis does not count.
    """
    knee, elbow = rotations[:, _KNEES], rotations[:, _ELBOWS]
    bend = torch.atan2(-elbow[..., 2, 0], elbow[..., 0, 0])
    return torch.cat([torch.atan2(knee[..., 2, 1], knee[..., 1, 1]), -bend[:, :1], bend[:, 1:]], 1)
