"""Depth term L_d as in the paper (Eq. 4): Chamfer distance between visible vertices and points."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from scipy.spatial import cKDTree
from torch import Tensor

from physic_core.engine.joint import PosedBodies, Sampling, Snapshot, Term
from physic_core.engine.state import State
from physic_core.errors import PhysicError
from physic_core.geometry import pixel_grid, unproject
from physic_core.types import ShortRepr


def chamfer_energy(
    vertices: Tensor,
    points: Tensor,
    nearest_point: Tensor,
    nearest_vertex: Tensor,
) -> Tensor:
    """Return L_d (Eq. 4) of one person: ``sum_v min_p |v - p|^2 + sum_p min_v |p - v|^2``, ()
    square metres.

    Args:
        vertices: (n, 3) camera-facing vertices, metres.
        points: (m, 3) human points in the scaled scene, metres.
        nearest_point: (n,) int64, of each vertex.
        nearest_vertex: (m,) int64, of each point.
    """
    to_points = (vertices - points[nearest_point]).square().sum()
    to_vertices = (points - vertices[nearest_vertex]).square().sum()
    return to_points + to_vertices


def human_points_of(state: State) -> tuple[Tensor, ...] | None:
    """Return the human points of each person (m, 3), metres; unprojected from the depth map if
    there are none.
    """
    depth = state.photo_depth
    if state.human_points is not None or depth is None:
        return state.human_points
    points = unproject(pixel_grid(depth.shape[0], depth.shape[1], depth), depth, state.K)
    return tuple(points[mask & (depth > 0)] for mask in state.masks)


@dataclass(frozen=True)
class HumanPoints(ShortRepr):
    """Points of each person in the unscaled scene, with k-d trees.

    Attributes:
        points: per person (m, 3) metres.
        trees: per person, k-d tree of the points.
    """

    points: tuple[Tensor, ...]
    trees: tuple[cKDTree, ...]

    @classmethod
    def from_state(cls, state: State) -> HumanPoints:
        """Collect ``human_points``, or unproject ``photo_depth`` inside each mask.

        Raises:
            PhysicError: the state has neither.
        """
        points = human_points_of(state)
        if points is None:
            raise PhysicError(
                "the depth term compares point clouds, but neither points of people nor a depth of "
                "the photo are there: give one, or set engine.joint.depth.weight = 0"
            )
        clouds = tuple(c[torch.isfinite(c).all(-1)] for c in points)
        return cls(clouds, tuple(cKDTree(c.double().numpy()) for c in clouds))

    def __call__(self, vertices: Tensor, facing: Tensor, log_scale: Tensor) -> Tensor:
        """Return Eq. 4 for each person. The points scale with the scene, without a gradient to its
        scale.

        Args:
            vertices: (B, n, 3) metres.
            facing: (B, n) bool, camera-facing vertices.
            log_scale: () of the scene.

        Returns:
            (B,) square metres; 0 for a person without points or camera-facing vertices.
        """
        scale = float(log_scale.detach().exp())
        return torch.stack(
            [
                self._person_points(i, v[f], scale)
                for i, (v, f) in enumerate(zip(vertices, facing, strict=True))
            ]
        )

    def _person_points(self, i: int, vertices: Tensor, scale: float) -> Tensor:
        """Return Eq. 4 of person i with camera-facing vertices (n, 3)."""
        points = self.points[i] * scale
        if not len(points) or not len(vertices):
            return vertices.sum() * 0.0
        now = vertices.detach().double().numpy()
        _, nearest_point = self.trees[i].query(now / scale)
        _, nearest_vertex = cKDTree(now, balanced_tree=False).query(points.double().numpy())
        return chamfer_energy(
            vertices,
            points,
            torch.from_numpy(nearest_point),
            torch.from_numpy(nearest_vertex),
        )


class ChamferDepthTerm(Term):
    """Depth term as in the paper: Chamfer distance (Eq. 4), for all people."""

    def __init__(self, weight: float, sampling: Sampling) -> None:
        self._weight = weight
        self._cloud = HumanPoints.from_state(sampling.state) if weight else None

    def refresh(self, snapshot: Snapshot) -> None:
        """Select the camera-facing vertices."""
        self.weights = {"depth": snapshot.visibility.facing}

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "depth"."""
        if self._cloud is None:
            return {}
        return {
            "depth": self._weight
            * self._cloud(bodies.vertices, self.weights["depth"], bodies.estimate.log_scale)
        }
