"""Camera of stage 1: the given intrinsics, or an estimate from point map and metric depth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physic_core.geometry.camera import focal_px, intrinsics_matrix, mean_camera
from physic_core.geometry.pointmap import intrinsics_from_pointmap


@dataclass(frozen=True)
class Cameras:
    """Intrinsics of a photo from several sources, each (3, 3) px or None if unknown.

    Attributes:
        given: known camera. It overrides the others, and every point is moved onto the ray of its pixel.
        metric_depth: camera that the metric depth was estimated for.
        pointmap: camera that the relative point map was estimated for.
    """

    given: Tensor | None = None
    metric_depth: Tensor | None = None
    pointmap: Tensor | None = None


def convert_to_common_camera(points: Tensor, depth: Tensor, cameras: Cameras) -> tuple[Tensor, Tensor, Cameras]:
    """Convert point map and metric depth to the given camera, or to the mean of their two cameras if none is given.

    If only one of the two cameras is known, nothing is converted.

    Metric depth is proportional to the focal length, since depth networks infer it from the size of objects in pixels.
    The depth of the point map does not change, since its unit is unknown.

    Args:
        points: (H, W, 3), any unit.
        depth: (H, W) metres.
        cameras: of the photo.

    Returns:
        The converted points, the converted depth, and the cameras with ``metric_depth`` set to the common one.
    """
    common, metric, pointmap = cameras.given, cameras.metric_depth, cameras.pointmap
    if common is None and metric is not None and pointmap is not None:
        common = mean_camera(metric.to(torch.float64), pointmap.to(metric.device, torch.float64))
    if common is None:
        return points, depth, replace(cameras, metric_depth=metric if metric is not None else pointmap)
    if pointmap is not None:
        factor = torch.diagonal(pointmap)[:2].to(points) / torch.diagonal(common)[:2].to(points)
        points = torch.cat((points[..., :2] * factor, points[..., 2:]), -1)
    if metric is not None:
        depth = depth * (focal_px(common) / focal_px(metric))
    return points, depth, replace(cameras, metric_depth=common)


def scene_camera(points: Tensor, valid: Tensor, cameras: Cameras) -> Tensor:
    """Return the intrinsics (3, 3) float64: given ones, otherwise those of the metric depth, otherwise from the point
    map.

    Args:
        points: (H, W, 3) point map, any unit.
        valid: (H, W) bool.
        cameras: of the photo.

    Raises:
        BackendOutputError: the camera cannot be estimated from the point map.
    """
    if cameras.given is not None:
        return cameras.given.to(points.device, torch.float64)
    if cameras.metric_depth is not None:
        return cameras.metric_depth.to(points.device, torch.float64)
    fx, fy, cx, cy = intrinsics_from_pointmap(points, valid)
    return intrinsics_matrix(fx, fy, cx, cy, torch.zeros((), dtype=torch.float64, device=points.device))
