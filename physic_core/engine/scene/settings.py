"""Settings of stage 1."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from physic_core.engine.bounds import NotNegative, PositiveOrInfinite

__all__ = ["OutlierMethod", "SceneSettings"]

OutlierMethod = Literal["grid", "knn", "off"]


@dataclass(frozen=True)
class SceneSettings:
    """Settings of stage 1: metric scene points, camera, normals, floor (paper Sec. 3.1).

    Attributes:
        source: geometry of the scene. "pointmap" is the relative point map, scaled to metres; "metric_depth" is the
            metric depth alone, as in the paper's comparison with PROX.
        align_residual: of Eq. 1. "relative" divides each residual by its depth, with 128 hypotheses; "metric" is Eq. 1
            as printed, in metres, with the 20 hypotheses of the released code.
        intrinsics: camera if none is given. "both" is the mean of the cameras of metric depth and point map, and the
            metric depth is scaled to it. "metric" takes the camera of the metric depth, else the point map's. Both put
            every point on the ray of its pixel. "pointmap" is the paper's median; points are not moved.
        outliers: removed points. "grid" removes depth edges and isolated pixels (fast). "knn" is the paper's mean
            distance to the k nearest points. "off" removes none.
        far_m: points beyond are removed, metres.
        normals: "own" ignores neighbours across a depth edge. "released" averages four cross products, and removes
            points whose normal differs from their neighbours'.
        floor: "disparity" fits a plane in inverse depth. "metric" is the paper's RANSAC on the points of the floor
            mask, with its grid of floor points. "off" finds no floor.
        floor_under_people: if no floor is found, fit one under the soles of people who stand or sit upright.
        carve_m: largest distance by which inpainted scene points are moved behind a body that contains or should
            occlude them, metres; 0 moves none.
    """

    source: Literal["pointmap", "metric_depth"] = "pointmap"
    align_residual: Literal["relative", "metric"] = "relative"
    intrinsics: Literal["both", "metric", "pointmap"] = "both"
    outliers: OutlierMethod = "grid"
    far_m: PositiveOrInfinite = 50.0
    normals: Literal["own", "released"] = "own"
    floor: Literal["disparity", "metric", "off"] = "disparity"
    floor_under_people: bool = True
    carve_m: NotNegative = 0.5
