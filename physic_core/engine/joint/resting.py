"""Hypothesis that feet and knees in the air rest on the surface under them, judged together with the pose.

The terms of contact and soles act over a few centimetres, so that a raised foot stays in the air. Errors of depth and
pose also lift feet and knees that rest, by a decimetre. People with such limbs are optimised again, with the limbs
pulled down. They rest if they reach the surface and the photo objects little: keypoints, depth, scene, estimated pose.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from physic_core.body.joints import SIDES, joint_pair
from physic_core.engine.joint.acceptance import term_totals
from physic_core.engine.joint.distances import hinge_angles, lowest_height, lowest_indices, plane_height
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.hanging import JudgedSupports
from physic_core.engine.joint.local_depth_scale import warp_share
from physic_core.engine.joint.optimiser import minimise
from physic_core.engine.joint.settings import JointSettings, LbfgsSettings
from physic_core.engine.joint.terms.resting import RestingLimbs, RestingTerm

__all__ = ["find_raised_limbs", "judge_resting"]

_HIPS, _KNEES, _ANKLES = joint_pair("hip"), joint_pair("knee"), joint_pair("ankle")

_MIN_GAP_M, _MAX_GAP_M = 0.04, 0.2  # nearer limbs are pulled by contact and soles; higher ones are in the air
_REACHED_M = 0.05  # a limb that stays farther from its surface was held back
_MIN_PROBABILITY = 0.5  # of contact, mean of a sole
_KNEELING_FLEXION = 1.0  # radians
_MAX_SHANK_COSINE = 0.5  # between up and a lower leg that may rest on the ground
_MIN_HIP_M = 0.15  # height of a hip over a knee that carries
_BESIDE_M, _MIN_POINTS = 0.15, 10  # level scene points around the lowest part of a limb make a step
_MIN_LEVEL_COSINE = 0.7
_MIN_STEP_M = 0.1  # lower points are floor that the point map bends
_ABOVE_M, _INSIDE_M = 0.05, 0.2  # a limb with level points this far over it is inside a step

_OBJECTING = ("reprojection", "depth", "penetration", "regularisation", "limits", "symmetry", "stature")
"""Terms that are compared: those that do not depend on what touches the scene."""

_TOUCHING_M, _MIN_DOWN_COSINE = 0.04, 0.3  # skin that rests on a surface is near it, and faces down
_BALANCE_M, _DIRECTIONS = 0.12, 36  # metres beside the hull, as for supports; supporting lines of the hull

_COST = 25.0
"""Energy by which these terms may rise."""

_TOLERANCE = 1e-3  # of the optimiser: one limb is a small share of an energy that has converged


def judge_resting(judged: JudgedSupports, settings: JointSettings) -> JudgedSupports:
    """Find the people whose raised feet or knees rest on the surface under them, and set their poses.

    Nobody is a candidate without a floor.

    Args:
        judged: energy at its minimum.
        settings: of stage 3.
    """
    energy, result, origin = judged.energy, judged.minimised, judged.energy.state.pack()
    limbs = find_raised_limbs(energy)
    if not bool(limbs.resting.any()):
        return judged
    terms, before = energy.terms, _objections(energy)
    optimiser = settings.optimiser
    if isinstance(optimiser, LbfgsSettings):
        optimiser = replace(optimiser, tolerance=min(optimiser.tolerance, _TOLERANCE))
    while bool(limbs.resting.any()):
        energy.terms = (*terms, RestingTerm(energy.context, limbs))
        found = minimise(energy, optimiser)
        energy.terms = terms
        energy.refresh()
        result = replace(result, evaluations=result.evaluations + found.evaluations, steps=result.steps + found.steps)
        held = limbs.resting & (_gaps(energy, limbs) > _REACHED_M)
        rejected = held.any(1) | (limbs.resting.any(1) & (_objections(energy) - before > _COST))
        if not bool(rejected.any()):
            with torch.no_grad():
                return replace(judged, minimised=replace(result, end=term_totals(energy())))
        # Without the rejected limbs the scene's scale is another one.
        energy.state.load(origin)
        energy.refresh()
        limbs = replace(limbs, resting=limbs.resting & ~rejected[:, None])
    return replace(judged, minimised=result)


@torch.no_grad()
def find_raised_limbs(energy: JointEnergy) -> RestingLimbs:
    """Return the feet and knees that are in the air over a surface and may rest on it; none without a floor.

    Such a knee is one that a person kneels on: it is bent, under the hip, and its lower leg is about level. Such a foot
    is in sight and likely touches something; its owner kneels, or nothing balances them. Neither is on a leg whose foot
    is known to be lifted.
    Who stands on one leg keeps the other in the air: the photo hardly objects to that foot on the floor.
    """
    context, problem, estimate = energy.context, energy.problem, energy.state.unpack()
    up = context.floor_normal
    if up is None:
        return RestingLimbs((), context.area.new_zeros(len(problem), 0), context.is_contact.new_zeros(len(problem), 0))
    scale = float(estimate.log_scale.exp())
    posed = context.pose(estimate.rotations, estimate.betas, estimate.transl, problem.expression0)
    kneeling = _kneeling(estimate.rotations, posed["joints"], up)
    if problem.lifted_feet is not None:
        kneeling &= ~problem.lifted_feet
    needed = kneeling.any(1) | ~_balanced(energy, posed["vertices"], up)
    may_rest = torch.cat([_feet_that_may_rest(energy) & needed[:, None], kneeling], 1)
    rows = (*context.soles, *_knee_rows(energy))
    may_rest &= torch.tensor([len(own) > 0 for own in rows], device=may_rest.device)
    if not bool(may_rest.any()):
        return RestingLimbs(rows, torch.zeros_like(may_rest, dtype=up.dtype), may_rest)
    height = plane_height(posed["vertices"], up, up.new_tensor(problem.floor_offset * scale)) / scale
    lowest = torch.stack([lowest_height(height[:, own]) if len(own) else height[:, 0] for own in rows], 1)
    target = torch.zeros_like(lowest)
    may_rest &= lowest > _MIN_GAP_M
    for person, limb in may_rest.nonzero().tolist():
        own = rows[limb]
        at = posed["vertices"][person, own][lowest_indices(height[person : person + 1, own])[0]].mean(0) / scale
        target[person, limb] = _step_height(energy, at, estimate.warp[person], float(lowest[person, limb]))
    gap = lowest - target
    return RestingLimbs(rows, target, may_rest & (gap > _MIN_GAP_M) & (gap < _MAX_GAP_M))


def _feet_that_may_rest(energy: JointEnergy) -> Tensor:
    """Return the feet (B, 2) bool that are in sight, likely touch something, and are not known to be lifted."""
    context, lifted = energy.context, energy.problem.lifted_feet
    none = torch.zeros_like(context.area[:, 0])
    soles = [context.contact_probability[:, rows] for rows in context.soles]
    likely = torch.stack([p.mean(1) if p.shape[1] else none for p in soles], 1) >= _MIN_PROBABILITY
    return likely & context.feet_visible & (torch.ones_like(likely) if lifted is None else ~lifted)


def _balanced(energy: JointEnergy, vertices: Tensor, up: Tensor) -> Tensor:
    """Return the people (B,) bool whose centre of mass is over the convex hull of skin that rests on scene or floor."""
    contacts, area = energy.contacts, energy.context.area
    distance = torch.minimum(contacts.signed.abs(), contacts.height.abs())
    carries = (distance < _TOUCHING_M) & (energy.visibility.normals @ up < -_MIN_DOWN_COSINE)
    carries &= ~energy.problem.feet_in_air()[:, energy.context.ids]
    centre = (area[:, None] @ vertices)[:, 0] / area.sum(1, keepdim=True)
    angle = torch.arange(_DIRECTIONS, device=up.device).to(up) * (2 * torch.pi / _DIRECTIONS)
    axes = torch.linalg.svd(up[None]).Vh[1:]
    directions = torch.stack([angle.cos(), angle.sin()], 1) @ axes
    farthest = torch.where(carries[..., None], vertices @ directions.T, -torch.inf).amax(1)
    outside: Tensor = (centre @ directions.T - farthest).amax(1)
    return outside < _BALANCE_M


def _kneeling(rotations: Tensor, joints: Tensor, up: Tensor) -> Tensor:
    """Return the knees (B, 2) bool that a person may kneel on."""
    bent = hinge_angles(rotations)[:, :2] > _KNEELING_FLEXION
    hip, knee, ankle = joints[:, _HIPS], joints[:, _KNEES], joints[:, _ANKLES]
    shank = torch.nn.functional.normalize(ankle - knee, dim=-1)
    return bent & ((shank @ up).abs() < _MAX_SHANK_COSINE) & ((hip - knee) @ up > _MIN_HIP_M)


def _knee_rows(energy: JointEnergy) -> tuple[Tensor, ...]:
    """Return the rows of the vertices of each lower leg that are nearer to the knee than to the ankle."""
    context, model = energy.context, energy.problem.model
    part, vertices, joints = model.part_of_vertex[context.ids], context.start.vertices[:, context.ids], context.start
    rows = []
    for side, knee, ankle in zip(SIDES, _KNEES, _ANKLES, strict=True):
        near, far = ((vertices - joints.joints[:, j, None]).norm(dim=-1) for j in (knee, ankle))
        own = (part == model.part_names.index(f"{side}_lower_leg")) & (near < far).all(0)
        rows.append(own.nonzero(as_tuple=True)[0])
    return tuple(rows)


def _step_height(energy: JointEnergy, at: Tensor, warp: Tensor, highest: float) -> float:
    """Return the height over the floor of the level surface under a point (3,), unscaled; 0 for the floor.

    It is NaN if the point is inside a step.
    """
    context, problem = energy.context, energy.problem
    points, up = context.surface, context.floor_normal
    if up is None or not len(points):
        return 0.0
    points = points * torch.exp(warp * warp_share(points, problem.floor_normal, problem.floor_offset))[:, None]
    high = plane_height(points, up, up.new_tensor(problem.floor_offset))
    beside = points - at
    beside = (beside - (beside @ up)[:, None] * up).norm(dim=-1)
    level = (context.surface_normals @ up > _MIN_LEVEL_COSINE) & (beside < _BESIDE_M)
    level = level & (high > _MIN_STEP_M)
    if int((level & (high > highest + _ABOVE_M) & (high < highest + _INSIDE_M)).sum()) >= _MIN_POINTS:
        return math.nan
    step = high[level & (high < highest + _ABOVE_M)]
    return float(step.median()) if len(step) >= _MIN_POINTS else 0.0


@torch.no_grad()
def _gaps(energy: JointEnergy, limbs: RestingLimbs) -> Tensor:
    """Return the distance (B, k) of each limb from its surface at the last refresh."""
    return limbs.gaps(energy.contacts.height / energy.state.unpack().log_scale.exp())


@torch.no_grad()
def _objections(energy: JointEnergy) -> Tensor:
    """Return the sum (B,) of the compared terms of each person."""
    energies = energy()
    return sum((energies[name] for name in _OBJECTING if name in energies), torch.zeros_like(energy.context.area[:, 0]))
