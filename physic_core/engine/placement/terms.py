"""Terms of stage 2 and their solvers.

Residuals and Jacobians are with respect to x = (t, g), a translation and a log depth offset.
Solvers are a closed form for keypoints alone, and Gauss-Newton. Float64, CPU, camera frame, metres
and pixels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from physic_core.geometry.camera import project
from physic_core.geometry.floor import PlaneFit
from physic_core.geometry.neighbors import nearest_indices, search_tree
from physic_core.geometry.robust import cauchy

FEWEST_KEYPOINTS = 3
"""Minimum number of confident keypoints to estimate a translation."""

NEAREST_M = 0.1
"""Minimum distance of a person from the camera, metres."""

_FLOOR_ROBUST_M = 0.3  # scale of the robust loss, metres

TRANSLATION = (0, 1, 2)
"""Elements of x that are the translation."""

ITERATIONS = 30
"""Largest number of Gauss-Newton steps."""


class PlacementProblem(NamedTuple):
    """Inputs to place one person, float64 on the CPU; N landmarks, V vertices, M points, S sole
    vertices.
    """

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
    floor: PlaneFit | None
    K: Tensor  # (3, 3)
    row: int  # of the person, among the people in the image
    people: int  # in the image

    @property
    def has_soles_on_floor(self) -> bool:
        """Whether the feet are visible and the scene has a floor."""
        return len(self.soles) > 0

    def median_error_px(self, x: Tensor) -> float:
        """Return the median reprojection error of a person moved by x (4,), px."""
        error = project(self.landmarks + x[:-1], self.K) - self.keypoints
        return float(torch.linalg.vector_norm(error, dim=-1).median())


class Residuals(NamedTuple):
    """Residuals of one term at x: error (N, D), Jacobian ``slope`` (N, D, 4), weight (N,), scale of
    the robust loss.
    """

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
        self.person = person
        self.weight = weight
        self.scale = scale

    def residuals(self, x: Tensor) -> list[Residuals]:
        moved = self.person.landmarks + x[:-1]
        z = moved[:, 2].clamp(min=NEAREST_M)
        size = self.person.size
        K = self.person.K
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

    def __init__(
        self, vertices: Tensor, points: Tensor, weights: tuple[float, float], scale: float
    ) -> None:
        self.vertices = vertices
        self.points = points
        self.weights = weights
        self.scale = scale
        self.vertex_tree = search_tree(vertices)
        self.point_tree = search_tree(points)

    def matched(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return the nearest point (F, 3) of each vertex, unscaled, and the nearest vertex (M, 3)
        of each point.
        """
        factor = math.exp(float(x[-1]))
        point, _ = nearest_indices(self.point_tree, (self.vertices + x[:-1]) / factor)
        vertex, _ = nearest_indices(self.vertex_tree, self.points * factor - x[:-1])
        return self.points[point], self.vertices[vertex]

    def residuals(self, x: Tensor) -> list[Residuals]:
        factor = math.exp(float(x[-1]))
        of_vertex, of_point = self.matched(x)
        identity = torch.eye(3, dtype=torch.float64)
        residuals_of_sides = []
        for vertices, points, weight in (
            (self.vertices, of_vertex, self.weights[0]),
            (of_point, self.points, self.weights[1]),
        ):
            scaled = points * factor
            slope = torch.cat((identity.expand(len(scaled), -1, -1), -scaled[:, :, None]), -1)
            error = vertices + x[:-1] - scaled
            residuals_of_sides.append(
                Residuals(error, slope, error.new_full((len(error),), weight), self.scale)
            )
        return residuals_of_sides


class PlacementFloorTerm:
    """Height of the lower foot above the floor, plus the prior ``cost g^2`` of the log depth offset
    g.
    """

    def __init__(self, person: PlacementProblem, weight: float, offset_cost: float) -> None:
        self.person = person
        self.weight = weight
        self.offset_cost = offset_cost

    def residuals(self, x: Tensor) -> list[Residuals]:
        floor = self.person.floor
        assert floor is not None
        lowest = floor.height(self.person.soles + x[:-1]).min().reshape(1, 1)
        upward = torch.zeros_like(x)
        upward[:-1] = floor.normal
        only_offset = torch.zeros_like(x)
        only_offset[-1] = 1.0
        foot = lowest.new_tensor([self.weight])
        cost = lowest.new_tensor([self.offset_cost])
        return [
            Residuals(lowest, upward[None, None], foot, _FLOOR_ROBUST_M),
            Residuals(x[-1].reshape(1, 1), only_offset[None, None], cost, math.inf),
        ]


class PlacementTerm(Protocol):
    """Summand of the energy of stage 2."""

    def residuals(self, x: Tensor) -> list[Residuals]:
        """Return the residuals at x (4,)."""


def closed_form_translation(person: PlacementProblem) -> Tensor:
    """Estimate the translation of Eq. 2 by linear least squares of X + t_x = u (Z + t_z); return x
    (4,).

    The solution is approximate: the weights of the rows approximate image errors.
    """
    ray = (person.keypoints - person.K[:2, 2]) / torch.stack((person.K[0, 0], person.K[1, 1]))
    joints = person.landmarks
    zero = torch.zeros(len(ray), dtype=torch.float64)
    one = torch.ones(len(ray), dtype=torch.float64)
    rows = torch.cat(
        (torch.stack((one, zero, -ray[:, 0]), -1), torch.stack((zero, one, -ray[:, 1]), -1))
    )
    goal = torch.cat(
        (ray[:, 0] * joints[:, 2] - joints[:, 0], ray[:, 1] * joints[:, 2] - joints[:, 1])
    )
    trust = person.confidence.repeat(2)
    move = torch.zeros_like(joints[0])
    # A weak prior of zero translation, for keypoints that do not determine depth.
    tie = torch.diag(torch.tensor([1e-9, 1e-9, 1e-6], dtype=torch.float64)) * trust.sum()
    for _ in range(3):
        depth = (joints[:, 2] + move[2]).clamp(min=NEAREST_M).repeat(2)
        weighted = rows * (trust / depth**2)[:, None]
        move = torch.linalg.solve(weighted.T @ rows + tie / depth.mean() ** 2, weighted.T @ goal)
    if float((joints[:, 2] + move[2]).min()) < NEAREST_M:
        move = torch.zeros_like(move)
    return torch.cat((move, torch.zeros(1, dtype=torch.float64)))


_CONVERGED_M = 1e-5
_HALVINGS = 6
_MAX_OFFSET = math.log(1e3)  # largest absolute log depth offset


def gauss_newton(terms: Sequence[PlacementTerm], x: Tensor, free: Sequence[int]) -> Tensor:
    """Minimise a sum of robust terms from x (4,) by iteratively reweighted Gauss-Newton steps.

    Only the elements of x with an index in ``free`` change. A step that increases the energy is
    halved.
    """
    index = torch.tensor(free)
    rows = [r for term in terms for r in term.residuals(x)]
    for _ in range(ITERATIONS):
        scales = [_robust_scale(r) for r in rows]
        energy = _energy(rows, scales)
        A = torch.zeros(len(x), len(x), dtype=torch.float64)
        b = torch.zeros_like(x)
        for r, scale in zip(rows, scales, strict=True):
            # Derivative of the Cauchy loss by the squared error: 1 / (1 + e^2 / c^2).
            weight = r.weight / (1 + r.error.square().sum(-1) / scale**2)
            A += torch.einsum("n,ndi,ndj->ij", weight, r.slope, r.slope)
            b += torch.einsum("n,ndi,nd->i", weight, r.slope, r.error)
        A = A[index][:, index]
        b = b[index]
        A = A + 1e-9 * torch.diag(A.diagonal().clamp(min=1e-12))
        step = torch.zeros_like(x)
        step[index] = torch.linalg.solve(A, -b)
        for _ in range(_HALVINGS):
            # The exponential of a larger offset may overflow.
            if abs(float(x[-1] + step[-1])) <= _MAX_OFFSET:
                tried = [r for term in terms for r in term.residuals(x + step)]
                if _energy(tried, scales) <= energy:
                    x = x + step
                    rows = tried
                    break
            step = step / 2
        else:
            break
        if float(step.abs().max()) < _CONVERGED_M:
            break
    return x


def _robust_scale(rows: Residuals) -> float:
    """Return the scale of the settings, or twice the median error if larger."""
    if not math.isfinite(rows.scale) or len(rows.error) < FEWEST_KEYPOINTS:
        return rows.scale
    return max(rows.scale, 2 * float(torch.linalg.vector_norm(rows.error, dim=-1).median()))


def _energy(rows: Sequence[Residuals], scales: Sequence[float]) -> float:
    total = 0.0
    for r, scale in zip(rows, scales, strict=True):
        squared = r.error.square().sum(-1)
        total += float(
            (r.weight * (cauchy(squared, scale) if math.isfinite(scale) else squared)).sum()
        )
    return total


def term_energy(term: PlacementTerm, x: Tensor) -> float:
    """Return the energy of one term at x = (t, g), (4,)."""
    rows = term.residuals(x)
    return _energy(rows, [r.scale for r in rows])
