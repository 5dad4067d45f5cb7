"""Stage 1's camera: the one that is known, or what point map and metric depth tell of it; and both of them for it."""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.engine.settings import SceneSettings
from physic_core.geometry.camera import focal_px, intrinsics_matrix, mean_camera
from physic_core.geometry.pointmap import intrinsics_from_pointmap

__all__ = ["camera_of", "of_one_camera"]


def of_one_camera(
    points: Tensor, depth: Tensor, K: Tensor | None, K_metric: Tensor | None, K_pointmap: Tensor | None
) -> tuple[Tensor, Tensor, Tensor | None]:
    """Point map and metric depth for the camera that is used, and that camera; None where none is known.

    What a depth network sees is the size of things, pixels times Z / f: with a longer focal length they are farther
    away. A point map's depths, whose unit is open, stay.
    """
    used = K
    if used is None and K_metric is not None and K_pointmap is not None:
        used = mean_camera(K_metric.to(torch.float64), K_pointmap.to(K_metric.device, torch.float64))
    if used is None:
        return points, depth, K_metric if K_metric is not None else K_pointmap
    if K_pointmap is not None:
        shrunk = torch.diagonal(K_pointmap)[:2].to(points) / torch.diagonal(used)[:2].to(points)
        points = torch.cat((points[..., :2] * shrunk, points[..., 2:]), -1)
    if K_metric is not None:
        depth = depth * (focal_px(used) / focal_px(K_metric))
    return points, depth, used


def camera_of(
    placed: Tensor | None,
    K: Tensor | None,
    K_metric: Tensor | None,
    points: Tensor,
    valid: Tensor,
    settings: SceneSettings,
) -> Tensor:
    """(3, 3) float64: the given camera, else what the settings prefer, else whatever there is."""
    if K is not None:
        return K.to(points.device, torch.float64)
    if K_metric is not None and (settings.intrinsics != "pointmap" or placed is None):
        return K_metric.to(points.device, torch.float64)
    fx, fy, cx, cy = intrinsics_from_pointmap(points if placed is None else placed, valid)
    return intrinsics_matrix(fx, fy, cx, cy, torch.zeros((), dtype=torch.float64, device=points.device))
