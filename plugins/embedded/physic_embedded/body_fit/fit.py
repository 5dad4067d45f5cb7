"""Fit the body model to 2D keypoints and 3D landmarks, people side by side.

Every unknown is divided by its standard deviation. On such whitened unknowns BFGS comes near a
minimum in about 20 steps; on raw ones it stalls.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_embedded.body_fit.fit_problem import (
    LIMB_ROWS,
    LiftedLimbs,
    fit_problem,
    with_outlines,
)
from physic_embedded.body_fit.lifter import HIPS, LimbView, predict_joints
from physic_embedded.body_fit.limb_keypoints import LIMBS, keypoint_indices
from physic_embedded.body_fit.minimise import approach_minimum, minimise

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body import BodyModel
    from physic_core.types import BoolArray, FloatArray
    from physic_embedded.body_fit.fit_problem import (
        FitProblem,
        FloorConstraint,
        InitialPose,
        OutlinePairs,
    )
    from physic_embedded.body_fit.observations import BodyObservations


_EVALUATIONS = 15  # which choose the minimum
_ROUGH = 1e-3  # standard deviations, of the last step of a fit that :func:`fit_outlines` continues
# How far 3D landmarks of arms move between two looks that are as sure as the lifter's joints, and
# the largest weight of these where looks differ. Chosen on mpi_inf_3dhp, panoptic and roundtable.
_STEADY_M = 0.05
_MOST_OF_ARM = 4.0


@dataclass(frozen=True)
class FittedBodies:
    """Fitted bodies of N people in the camera frame, metres; tensors of the model's float type.

    Attributes:
        rotations: (N, 55, 3, 3).
        betas: (N, K).
        transl: (N, 3).
        joints: (N, 55, 3).
        loss: (N,) final loss without the terms of floor and outlines, so that fits with and without
            them compare.
        problem: that was solved.
        unknowns: (N, W) its solution.
    """

    rotations: Tensor
    betas: Tensor
    transl: Tensor
    joints: Tensor
    loss: FloatArray
    problem: FitProblem
    unknowns: Tensor


def fit_bodies(
    model: BodyModel,
    observations: BodyObservations,
    start: InitialPose,
    *,
    floor: FloorConstraint | None = None,
    starts: int = 1,
    earlier_fits: tuple[FittedBodies, BoolArray] | None = None,
    continues: bool = False,
) -> FittedBodies:
    """Fit the body model to the keypoints and landmarks of N people, and return the best fit of
    each person, which :func:`fit_outlines` continues to the minimum.

    Args:
        model: body model, float64.
        observations: keypoints and landmarks of the people.
        start: initial poses.
        floor: constraint of the floor; None without a floor.
        starts: initial poses of each person. N is the number of people times this, one start of all
            people after the other.
        earlier_fits: an earlier fit of N people from one start, and for whom (N,) anything has
            changed since. The others are not fitted again.
        continues: whether the initial poses are those of the earlier fit, which is near to this
            one.
    """
    problem = fit_problem(model, observations, start, floor)
    if earlier_fits is not None:
        fit, changed = earlier_fits
        rows = torch.from_numpy(np.flatnonzero(changed))
        part = problem.select(rows)
        solution = fit.unknowns.clone()
        near = solution[rows] if continues else _search_minimum(part)
        solution[rows] = minimise(part, near, least_step=_ROUGH)
        return _body_fit(model, problem, solution)
    unknowns = _search_minimum(problem)
    with torch.no_grad():
        best = problem.loss(unknowns).view(starts, -1).argmin(0)
    rows = best * len(best) + torch.arange(len(best))
    problem = problem.select(rows)
    solution = minimise(problem, unknowns[rows], least_step=_ROUGH)
    return _body_fit(model, problem, solution)


def fit_outlines(
    model: BodyModel, fit: FittedBodies, pairs: OutlinePairs, lifted: LiftedLimbs | None = None
) -> FittedBodies:
    """Continue a fit of N people with pairs of points on the outlines of bodies and masks, and with
    what the lifter tells of their limbs.

    The fit is nearly a minimum without them, and near to the one with them.
    """
    problem = with_outlines(fit.problem, pairs, lifted)
    return _body_fit(model, problem, minimise(problem, fit.unknowns))


def lifted_limbs(
    fit: FittedBodies,
    observations: BodyObservations,
    up: FloatArray | None,
    legs_hidden: BoolArray,
) -> LiftedLimbs:
    """Ask the lifter for the limbs of N fitted bodies, camera frame.

    Args:
        fit: the bodies.
        observations: the keypoints that they were fitted to.
        up: (3,) unit vector, None where unknown.
        legs_hidden: (N,) people whose legs are hidden: nothing is told of their knees and ankles.
    """
    index = keypoint_indices(observations.skeleton)
    columns = [index[name] for name in LIMBS]
    joints = fit.joints.double().numpy()[:, LIMB_ROWS]
    hips_center = joints[:, HIPS].mean(1, keepdims=True)
    depth = (hips_center @ observations.turn)[:, 0, 2]
    fitted = (joints - hips_center) @ observations.turn
    pixels = observations.points[:, columns]
    rays = np.concatenate([pixels, np.ones_like(pixels[..., :1])], -1)
    seen_points = rays @ np.linalg.inv(observations.intrinsics.matrix).T @ observations.turn
    predicted = predict_joints(
        LimbView(
            fitted,
            seen_points[..., :2] / seen_points[..., 2:] * depth[:, None, None],
            observations.confidence[:, columns],
            observations.turn.transpose(0, 2, 1) @ (np.zeros(3) if up is None else up),
            depth,
        )
    )
    distance = np.linalg.norm(predicted - fitted, axis=-1)
    weight = np.ones(predicted.shape[:2])
    for row, name in enumerate(LIMBS):
        if name.endswith(("knee", "ankle")):
            weight[legs_hidden, row] = 0
        elif observations.spread is not None and name.endswith(("elbow", "wrist")):
            turned = observations.spread[:, columns[row]] / _STEADY_M
            weight[:, row] = np.minimum(1 + turned**2, _MOST_OF_ARM)
    return LiftedLimbs(
        torch.from_numpy(predicted), torch.from_numpy(weight), torch.from_numpy(distance)
    )


def _search_minimum(problem: FitProblem) -> Tensor:
    """Return the unknowns (N, W) that the search reaches from the initial poses."""
    start = problem.points.new_zeros(len(problem.points), problem.num_unknowns)
    return approach_minimum(problem, start, _EVALUATIONS)


def _body_fit(model: BodyModel, problem: FitProblem, unknowns: Tensor) -> FittedBodies:
    with torch.no_grad():
        loss, _ = problem.terms(unknowns)
        body = problem.decode(unknowns)
        joints = model(body.rotations, body.betas, body.transl, joints_only=True).joints
        return FittedBodies(
            body.rotations.detach(),
            body.betas.detach(),
            body.transl.detach(),
            joints,
            loss.double().numpy(),
            problem,
            unknowns.detach(),
        )
