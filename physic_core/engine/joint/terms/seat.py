"""Seat term: thighs and buttocks of people who sit rest on a level surface, also where it is far from them.

The contact term loses a surface that is farther than ``max_distance_m``. A person who sits is on a seat, whatever the
errors of their distance from the camera and of the scene's.
"""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.distances import plane_height
from physic_core.engine.joint.state import State
from physic_core.engine.joint.term import PosedBodies, RobustLoss, Snapshot, Term
from physic_core.engine.joint.terms.contact import ContactSettings
from physic_core.geometry.neighbors import NearestPointSearch, inside_body_boxes
from physic_core.geometry.robust import robust_loss

__all__ = ["SeatTerm", "seat_energy"]

_SIGMA_M, _OUTLIER_SIGMAS = 0.03, 2.0
_MIN_LEVEL_COSINE = 0.7  # between up and the normal of a seat
_MIN_SEAT_M = 0.1  # height of a seat over the floor; lower points may be floor that the point map bends
_MIN_DOWN_COSINE = 0.3  # between down and the normal of a vertex that rests on a seat
_MAX_BESIDE_M = 0.2  # metres beside a vertex; the person hides the middle of the seat
_MAX_INSIDE_M = 0.2  # metres of a vertex inside a seat; deeper, the surface is a table or an armrest
_LOWEST_SHARE = 0.3  # of the vertices over a seat, those nearest to it
_MIN_SHARE = 0.25  # of the vertices that face down; fewer over a level surface are not enough for a seat
_MAX_MOTION_M = 0.6  # of people, metres


def seat_energy(gap: Tensor, weight: Tensor, rho: RobustLoss) -> Tensor:
    """Return the seat energy of each person (B,): ``w rho(g^2)``.

    Args:
        gap: (B,) mean signed distance of the lowest vertices of thighs and buttocks to the seat, metres.
        weight: (B,), 0 for people who do not sit.
        rho: robust loss of squared metres, which does not redescend to zero slope within the reach.
    """
    return weight * rho(gap.square())


def _rho(squared: Tensor) -> Tensor:
    return robust_loss("cauchy", squared / _SIGMA_M**2, _OUTLIER_SIGMAS)


class SeatTerm(Term):
    """Seat term of people who sit, see :func:`physic_core.engine.joint.limbs.is_sitting`.

    Args:
        settings: of the contact term.
        state: free parameters.

    Attributes:
    """

    def __init__(self, settings: ContactSettings, context: JointContext, state: State) -> None:
        self._settings, self._context, self._state = settings, context, state
        self._people = context.sitting.nonzero(as_tuple=True)[0]
        self.weights = {"seat": context.sitting.to(context.area.dtype)}
        self.found = torch.zeros_like(context.area[:, 0])
        self._rows = self._normals = self._distance = self._mean = torch.zeros(0)
        problem = context.problem
        self._up = (
            problem.transl0.new_tensor([0.0, -1.0, 0.0]) if context.floor_normal is None else context.floor_normal
        )
        self._search: NearestPointSearch | None = None
        if not (settings.weight and settings.seat_weight and len(self._people) and len(context.surface)):
            return
        model = problem.model
        seat = torch.zeros(model.num_vertices, dtype=torch.bool, device=context.ids.device)
        for name in ("thighs", "gluteus"):
            seat[model.contact_sets[name]] = True
        self._rows = seat[context.ids].nonzero(as_tuple=True)[0]
        points, normals = _level_points(context, self._up, settings.seat_reach_m + _MAX_MOTION_M)
        if len(points) and len(self._rows):
            self._search = NearestPointSearch(points, normals, settings.seat_reach_m)

    @torch.no_grad()
    def refresh(self, snapshot: Snapshot) -> None:
        """Find the seat under each person who sits."""
        if self._search is None:
            return
        context, people, rows = self._context, self._people, self._rows
        vertices = snapshot.vertices[people][:, rows]
        found = self._search.query(vertices, snapshot.scale)
        points, self._normals = self._search.points[found.index], self._search.normals[found.index]
        self._distance = (self._normals * points).sum(-1)
        offset = vertices - points * snapshot.scale
        along = (offset * self._normals).sum(-1)
        beside = (offset - along[..., None] * self._normals).norm(dim=-1)
        down = snapshot.visibility.normals[people][:, rows] @ self._up < -_MIN_DOWN_COSINE
        over = down & found.found & (beside < _MAX_BESIDE_M) & (along > -_MAX_INSIDE_M)
        over &= (over.sum(1) > _MIN_SHARE * down.sum(1).clamp(min=1))[:, None]
        # The lowest vertices alone: a body rests on what touches first.
        rank = torch.where(over, along, torch.inf).argsort(1).argsort(1)
        chosen = over & (rank < (_LOWEST_SHARE * over.sum(1, keepdim=True)).ceil())
        area = context.area[people][:, rows] * chosen
        self._mean = area / area.sum(1, keepdim=True).clamp(min=1e-9)
        self.found = torch.zeros_like(self.found).index_copy(0, people, over.any(1).to(self.found.dtype))

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "seat"; zero if no person sits."""
        if self._search is None:
            return {}
        estimate, people = bodies.estimate, self._people
        vertices = bodies.vertices[people][:, self._rows]
        signed = (self._normals * vertices).sum(-1) / estimate.log_scale.exp() - self._distance
        # A lost seat costs as much as one at the limit of the reach: else the minimum would be away from all seats.
        lost = torch.full_like(signed[:, 0], self._settings.seat_reach_m)
        nearest = torch.where(self._mean.sum(1) > 0, (self._mean * signed).sum(1), lost)
        gap = torch.zeros_like(bodies.vertices[:, 0, 0]).index_copy(0, people, nearest)
        weight = self._settings.weight * self._settings.seat_weight * self.weights["seat"]
        return {"seat": seat_energy(gap, weight, _rho)}


def _level_points(context: JointContext, up: Tensor, margin: float) -> tuple[Tensor, Tensor]:
    """Return the level scene points over the floor near people who sit, and their normals: (M, 3) each."""
    points, normals = context.surface, context.surface_normals
    level = normals @ up > _MIN_LEVEL_COSINE
    if context.floor_normal is not None:
        offset = points.new_tensor(context.problem.floor_offset)
        level = level & (plane_height(points, context.floor_normal, offset) > _MIN_SEAT_M)
    points, normals = points[level], normals[level]
    near = inside_body_boxes(points, context.start.vertices[context.sitting], margin)
    return points[near], normals[near]
