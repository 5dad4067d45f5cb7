"""The paper's depth term (Eq. 4): people's visible vertices against their points, both ways, nearest to nearest."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from scipy.spatial import cKDTree
from torch import Tensor

from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.joint.terms import chamfer
from physic_core.errors import PhysicError
from physic_core.geometry.camera import pixel_grid, unproject
from physic_core.types.short_repr import ShortRepr

__all__ = ["HumanCloud"]


@dataclass(frozen=True)
class HumanCloud(ShortRepr):
    """Human points of each person, in the unscaled scene, with their search trees.

    Attributes:
        points: per person (m, 3) metres.
        share: per person, how many of the original points each of them stands for.
        trees: per person.
    """

    points: tuple[Tensor, ...]
    share: tuple[float, ...]
    trees: tuple[cKDTree, ...]

    @classmethod
    def of(cls, problem: JointProblem, most: int) -> HumanCloud:
        """From ``human_points``, or from ``human_depth`` under each mask; at most ``most`` a person, evenly picked.

        Raises:
            PhysicError: the problem has neither.
        """
        if problem.human_points is not None:
            clouds = list(problem.human_points)
        elif problem.human_depth is not None:
            depth = problem.human_depth
            points = unproject(pixel_grid(depth.shape[0], depth.shape[1], depth), depth, problem.K)
            clouds = [points[mask & (depth > 0)] for mask in problem.masks]
        else:
            raise PhysicError(
                "the depth term compares point clouds, but there are neither human_points nor human_depth: give one,"
                " or set depth_weight = 0"
            )
        clouds = [c[torch.isfinite(c).all(-1)] for c in clouds]
        step = [max(1, -(-len(c) // most)) if most else 1 for c in clouds]
        picked = tuple(c[::k] for c, k in zip(clouds, step, strict=True))
        share = tuple(len(c) / max(1, len(p)) for c, p in zip(clouds, picked, strict=True))
        return cls(picked, share, tuple(cKDTree(p.cpu().double().numpy()) for p in picked))

    def __call__(self, vertices: Tensor, facing: Tensor, log_scale: Tensor) -> Tensor:
        """Eq. 4 for each person; the points follow the scene's scale without pulling at it.

        Args:
            vertices: (B, n, 3) metres.
            facing: (B, n) bool, camera-facing vertices.
            log_scale: () of the scene.

        Returns:
            (B,) square metres; 0 for a person without points or camera-facing vertices.
        """
        scale = float(log_scale.detach().exp())
        return torch.stack(
            [self._person(i, v[f], scale) for i, (v, f) in enumerate(zip(vertices, facing, strict=True))]
        )

    def _person(self, i: int, vertices: Tensor, scale: float) -> Tensor:
        points = self.points[i] * scale
        if not len(points) or not len(vertices):
            return vertices.sum() * 0.0
        now = vertices.detach().cpu().double().numpy()
        _, nearest_point = self.trees[i].query(now / scale)
        _, nearest_vertex = cKDTree(now, balanced_tree=False).query(points.cpu().double().numpy())
        device = vertices.device
        return chamfer(
            vertices,
            points,
            torch.from_numpy(nearest_point).to(device),
            torch.from_numpy(nearest_vertex).to(device),
            self.share[i],
        )
