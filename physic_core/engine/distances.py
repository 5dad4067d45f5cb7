"""Distances to planes, heights of soles, and angles of knees and elbows. Camera frame, metres."""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.body.joints import joint_pair

# Entries of the 55 rotation matrices, flattened: knees turn by rows 2 and 1 of column 1, elbows by rows 2 and 0 of
# column 0. One gather of eight numbers has a cheap gradient.
_HINGE_SINES = [9 * joint + 7 for joint in joint_pair("knee")] + [9 * joint + 6 for joint in joint_pair("elbow")]
_HINGE_COSINES = [9 * joint + 4 for joint in joint_pair("knee")] + [9 * joint for joint in joint_pair("elbow")]
_HINGE_SIGNS = (1.0, 1.0, 1.0, -1.0)
_LOWEST_SHARE = 0.05  # of a sole's vertices: on tiptoe only this share touches the floor


def signed_distance(vertices: Tensor, points: Tensor, normals: Tensor) -> Tensor:
    """Return the signed distance of vertices to the planes through scene points: ``n . (v - p)``, negative inside.

    Vertices, points and unit normals (..., 3) -> (...) metres. Normals point to the camera's side.
    """
    return (normals * (vertices - points)).sum(-1)


def lowest_sole_indices(height: Tensor) -> Tensor:
    """Return the indices of the lowest 5 % of the vertices of a foot's sole: heights (B, n) -> (B, n / 20) int64."""
    count = max(1, round(_LOWEST_SHARE * height.shape[-1]))
    return height.topk(count, dim=-1, largest=False).indices


def lowest_height(height: Tensor) -> Tensor:
    """Return the mean height of the lowest 5 % of a sole's vertices: (B, n) -> (B,) metres."""
    return height.gather(-1, lowest_sole_indices(height)).mean(-1)


def root_relative(vertices: Tensor, pelvis: Tensor, root: Tensor) -> Tensor:
    """Return vertices (B, V, 3) in the frame of the root joint: ``R^T (v - pelvis)``.

    ``pelvis`` is (B, 3), ``root`` the rotation (B, 3, 3).
    """
    return (vertices - pelvis[:, None]) @ root


def hinge_angles(rotations: Tensor) -> Tensor:
    """Return the flexion of left knee, right knee, left elbow, right elbow: (B, 55, 3, 3) -> (B, 4) radians.

    0 is straight. Knees bend about x, elbows about y (the left one in the opposite direction). Twist about the limb's
    own axis is ignored.
    """
    entries = torch.tensor(_HINGE_SINES + _HINGE_COSINES, device=rotations.device)
    sine, cosine = torch.split(rotations.flatten(1).index_select(1, entries), 4, dim=1)
    return torch.atan2(sine * sine.new_tensor(_HINGE_SIGNS), cosine)
