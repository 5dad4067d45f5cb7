"""Terms of stage 2: residuals and Jacobians with respect to x = (t, g), a translation and a log depth offset.

Float64, CPU, camera frame, metres and pixels.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import torch
from scipy.spatial import cKDTree
from torch import Tensor

from physic_core.geometry.camera import project
from physic_core.geometry.plane import height_over_plane

FEWEST_KEYPOINTS = 3
"""Minimum number of confident keypoints to estimate a translation."""

NEAREST_M = 0.1
"""Minimum distance of a person from the camera, metres."""

_FLOOR_ROBUST_M = 0.3  # scale of the robust loss, metres


class PlacementProblem(NamedTuple):
    """Inputs to place one person, float64 on the CPU; N landmarks, V vertices, M points, S sole vertices."""

    landmarks: Tensor  # (N, 3)
    keypoints: Tensor  # (N, 2)
    confidence: Tensor  # (N,), at least the settings' minimum
    size: Tensor  # (2,) px, divisor of 2D errors
    vertices: Tensor  # (V, 3)
    normals: Tensor  # (V, 3)
    outer: Tensor  # (V,) bool
    points: Tensor  # (M, 3)
    mask: Tensor  # (H, W) bool
    soles: Tensor  # (S, 3), empty if the feet are invisible or there is no floor
    plane: Tensor | None  # (4,) normal and offset of the floor
    K: Tensor  # (3, 3)
    row: int  # of the person, among the people in the image
    people: int  # in the image

    @property
    def on_floor(self) -> bool:
        """Whether the feet are visible and the scene has a floor."""
        return len(self.soles) > 0

    def foot_height(self, x: Tensor) -> Tensor:
        """Return the height () of the lower foot above the floor, metres, of a person moved by x (4,)."""
        assert self.plane is not None
        return height_over_plane(self.soles + x[:-1], self.plane[:-1], self.plane[-1]).min()


class Residuals(NamedTuple):
    """Residuals of one term at x: error (N, D), Jacobian ``slope`` (N, D, 4), weight (N,), scale of the robust loss."""

    error: Tensor
    slope: Tensor
    weight: Tensor
    scale: float


class PlacementReprojectionTerm:
    """Reprojection error (Eq. 2) relative to the person's or image's size.

    Args:
        weight: (N,) of each keypoint.
        scale: of the robust loss of relative errors; "inf" is least squares.
    """

    def __init__(self, person: PlacementProblem, weight: Tensor, scale: float) -> None:
        self.person, self.weight, self.scale = person, weight, scale

    def residuals(self, x: Tensor) -> list[Residuals]:
        moved = self.person.landmarks + x[:-1]
        z = moved[:, 2].clamp(min=NEAREST_M)
        size, K = self.person.size, self.person.K
        error = (project(moved, K) - self.person.keypoints) / size
        slope = torch.zeros((len(moved), 2, len(x)), dtype=torch.float64)
        for axis in (0, 1):
            slope[:, axis, axis] = K[axis, axis] / z / size[axis]
            slope[:, axis, 2] = -K[axis, axis] * moved[:, axis] / z**2 / size[axis]
        return [Residuals(error, slope, self.weight, self.scale)]


class ChamferTerm:
    """Bidirectional Chamfer distance (Eq. 4) of camera-facing vertices and the person's points.

    Args:
        vertices: (F, 3) camera-facing vertices.
        points: (M, 3) of the person.
        weights: of each vertex and of each point.
        scale: of the robust loss, metres; "inf" is least squares.
    """

    def __init__(self, vertices: Tensor, points: Tensor, weights: tuple[float, float], scale: float) -> None:
        self.vertices, self.points, self.weights, self.scale = vertices, points, weights, scale
        self.vertex_tree, self.point_tree = cKDTree(vertices.numpy()), cKDTree(points.numpy())

    def matched(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return the nearest point (F, 3) of each vertex, unscaled, and the nearest vertex (M, 3) of each point."""
        factor = math.exp(float(x[-1]))
        _, nearest_point = self.point_tree.query(((self.vertices + x[:-1]) / factor).numpy())
        _, nearest_vertex = self.vertex_tree.query((self.points * factor - x[:-1]).numpy())
        return self.points[torch.as_tensor(nearest_point)], self.vertices[torch.as_tensor(nearest_vertex)]

    def residuals(self, x: Tensor) -> list[Residuals]:
        factor = math.exp(float(x[-1]))
        of_vertex, of_point = self.matched(x)
        identity = torch.eye(3, dtype=torch.float64)
        found = []
        for vertices, points, weight in (
            (self.vertices, of_vertex, self.weights[0]),
            (of_point, self.points, self.weights[1]),
        ):
            scaled = points * factor
            slope = torch.cat((identity.expand(len(scaled), -1, -1), -scaled[:, :, None]), -1)
            error = vertices + x[:-1] - scaled
            found.append(Residuals(error, slope, error.new_full((len(error),), weight), self.scale))
        return found

    def median(self, x: Tensor) -> float:
        """Return the median distance over both directions, metres."""
        return float(torch.cat([torch.linalg.vector_norm(r.error, dim=-1) for r in self.residuals(x)]).median())


class PlacementFloorTerm:
    """Height of the lower foot above the floor, plus the prior ``cost g^2`` of the log depth offset g."""

    def __init__(self, person: PlacementProblem, weight: float, offset_cost: float) -> None:
        self.person, self.weight, self.offset_cost = person, weight, offset_cost

    def residuals(self, x: Tensor) -> list[Residuals]:
        assert self.person.plane is not None
        lowest = self.person.foot_height(x).reshape(1, 1)
        upward, only_offset = self.person.plane.clone(), torch.zeros_like(x)
        upward[-1], only_offset[-1] = 0.0, 1.0
        foot, cost = lowest.new_tensor([self.weight]), lowest.new_tensor([self.offset_cost])
        return [
            Residuals(lowest, upward[None, None], foot, _FLOOR_ROBUST_M),
            Residuals(x[-1].reshape(1, 1), only_offset[None, None], cost, math.inf),
        ]


class PlacementTerm(Protocol):
    """Summand of the energy of stage 2."""

    def residuals(self, x: Tensor) -> list[Residuals]:
        """Return the residuals at x (4,)."""
