"""Derivatives of the body fit. For the second ones a body is posed once, not once for each unknown.

Posed points are linear in each rotation matrix, and in the shape. A difference of gradients in
which the points are linear in all of these at once therefore lacks only what two joints, or a joint
and the shape, move together. That is a sum over the points below a joint.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from physic_embedded.body_fit.fit_problem import NUM_TURNED
from physic_embedded.body_fit.point_motions import point_motions

if TYPE_CHECKING:
    from torch import Tensor

    from physic_embedded.body_fit.fit_problem import DecodedUnknowns, FitProblem
    from physic_embedded.body_fit.point_motions import PointMotions

_STEP_SIZE = 1e-5  # of an unknown: the difference of two gradients is a row of the Hessian


def loss_and_gradient(problem: FitProblem, unknowns: Tensor) -> tuple[Tensor, Tensor]:
    """Return loss (N,) and gradient (N, W)."""
    at = unknowns.detach().requires_grad_(True)
    losses = problem.loss(at)
    (gradient,) = torch.autograd.grad(losses.sum(), at)
    return losses.detach(), gradient


def derivatives(problem: FitProblem, unknowns: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return loss (N,), gradient (N, W) and Hessian (N, W, W)."""
    count, width = unknowns.shape
    model = problem.landmarks
    body = problem.decode(unknowns)
    motions = point_motions(model.tree, model.skin, body.rotations, body.betas, NUM_TURNED)
    posed = problem.loss_points(model(body.rotations, body.betas, body.transl))
    # the first row is zero
    steps = _STEP_SIZE * torch.eye(width + 1, width, dtype=unknowns.dtype).roll(1, 0)
    stepped = (unknowns[:, None] + steps).flatten(0, 1).requires_grad_(True)
    rows = problem.select(torch.arange(count).repeat_interleave(width + 1))
    moved_bodies = rows.decode(stepped)
    turned = _rotation_changes(motions, body, moved_bodies)
    points = _linear_points(problem, motions, torch.cat(posed, 1), turned, body, moved_bodies)
    parts = torch.split(points.flatten(0, 1), [part.shape[1] for part in posed], 1)
    data, constraints = rows.terms_at_points(stepped, moved_bodies, parts)
    losses = data + constraints
    gradients, twist, pull = torch.autograd.grad(losses.sum(), [stepped, turned, points])
    gradients = gradients.view(count, width + 1, width)
    hessian = (gradients[:, 1:] - gradients[:, :1]) / _STEP_SIZE
    hessian = (hessian + hessian.mT) / 2

    cross = _cross_terms(problem, motions, turned.detach(), twist[:, 0], pull[:, 0])
    hessian[:, : cross.shape[1], : cross.shape[1]] += cross
    return losses.detach().view(count, -1)[:, 0], gradients[:, 0], hessian


def _rotation_changes(
    motions: PointMotions, body: DecodedUnknowns, moved: DecodedUnknowns
) -> Tensor:
    """Return by how much (N, S, 22, 3, 3) joints turn in S steps from ``body`` to ``moved``."""
    turned = moved.rotations.view(len(body.rotations), -1, *body.rotations.shape[1:])
    turned = turned[:, :, :NUM_TURNED] - body.rotations[:, None, :NUM_TURNED]
    return motions.parents[:, None] @ turned @ motions.world[:, None].mT


def _linear_points(
    problem: FitProblem,
    motions: PointMotions,
    posed: Tensor,
    turned: Tensor,
    body: DecodedUnknowns,
    moved: DecodedUnknowns,
) -> Tensor:
    """Return the points (N, S, P, 3) of the loss after S small steps, linear in all of them.

    Args:
        problem: of N people.
        motions: of joints and vertices.
        posed: (N, P, 3) points before the steps.
        turned: (N, S, 22, 3, 3), see :func:`_rotation_changes`.
        body: N bodies before the steps.
        moved: N times S bodies after them.
    """
    steps = turned.shape[:2]
    shift = moved.transl.view(*steps, 3, 1) - body.transl[:, None, :, None]
    shape = moved.betas.view(*steps, -1) - body.betas[:, None]
    # The translation is one more column, with the share that each point has of it.
    shares = _loss_points(problem, torch.ones_like(motions.by_shape[:, :1]))[..., 0]
    moments = _loss_points(problem, motions.moments).mT.flatten(1, 2)
    columns = torch.cat([turned.transpose(2, 3).flatten(3), shift], 3).flatten(1, 2)
    carried = columns @ torch.cat([moments, shares], 1)
    by_shape = _loss_points(problem, motions.by_shape).flatten(2)
    shaped = torch.baddbmm(posed.flatten(1)[:, None], shape, by_shape)
    return shaped.view(*steps, -1, 3) + carried.view(*steps, 3, -1).mT


def _cross_terms(
    problem: FitProblem, motions: PointMotions, turned: Tensor, twist: Tensor, pull: Tensor
) -> Tensor:
    """Return what two joints, and joints and shape, contribute to the Hessian (N, 66 + K, 66 + K).

    Args:
        problem: of N people.
        motions: of joints and vertices.
        turned: (N, W + 1, 22, 3, 3) by a step of each unknown.
        twist: (N, 22, 3, 3) gradient by them.
        pull: (N, P, 3) gradient by the points of the loss.
    """
    turning = 3 * NUM_TURNED
    # (N, 22, 3, 3, 3): of each joint by a unit of each of its unknowns
    units = turned[:, 1 : turning + 1].view(-1, NUM_TURNED, 3, NUM_TURNED, 3, 3)
    units = units.diagonal(dim1=1, dim2=3)
    units = units.permute(0, 4, 1, 2, 3) / _STEP_SIZE
    lower = twist[:, :, None] @ units.mT
    joints = units.flatten(3).flatten(1, 2) @ lower.flatten(3).flatten(1, 2).mT
    below = problem.landmarks.tree.family[:NUM_TURNED, :NUM_TURNED].triu(1)
    joints = joints * below.repeat_interleave(3, 0).repeat_interleave(3, 1)

    raw = motions.by_shape[:, 0].requires_grad_(True)
    # Of a sum, since a gradient of several outputs makes torch import its compiler.
    (by_point,) = torch.autograd.grad((_loss_points(problem, raw) * pull).sum(), raw)
    by_shape = motions.moments_by_shape(by_point).flatten(3)  # (N, K, 22, 9)
    shapes = (units.flatten(3) @ by_shape.permute(0, 2, 3, 1)).flatten(1, 2)
    hessian = torch.cat([joints, shapes], 2)
    hessian = torch.cat(
        [hessian, hessian.new_zeros(len(hessian), shapes.shape[2], hessian.shape[2])], 1
    )
    return hessian + hessian.mT


def _loss_points(problem: FitProblem, points: Tensor) -> Tensor:
    """Return the points (..., P, 3) of the loss of joints and vertices (..., 55 + n, 3)."""
    joints, vertices = points.tensor_split([len(problem.landmarks.tree.family)], -2)
    return torch.cat(problem.loss_points(problem.landmarks.named(joints, vertices)), -2)
