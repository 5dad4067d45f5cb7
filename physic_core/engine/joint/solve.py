"""Stage 3: joint optimisation of people and scene (paper sec. 3.3, Eq. 5), with diagnostics per person."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import torch
from torch import Tensor

from physic_core.engine.joint.contact_state import update_contacts
from physic_core.engine.joint.distances import lowest_height, plane_height
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.optimiser import MinimisationResult
from physic_core.engine.joint.problem import JointProblem, JointResult, people_with_valid_start
from physic_core.engine.joint.settings import JointSettings
from physic_core.engine.joint.state import Estimate
from physic_core.geometry.camera import project
from physic_core.geometry.visibility import depth_order_violations

__all__ = ["DEEP_M", "JointProblem", "JointResult", "optimize"]

DEEP_M = 0.03
"""Depth inside the scene, metres; deeper vertices are a visible error."""

_INVALID_START = "the start has non-finite parameters or is behind the camera"
_INVALID_ENERGY = "the energy of the start is not finite"


def optimize(
    problem: JointProblem, settings: JointSettings, progress: Callable[[float], None] | None = None
) -> JointResult:
    """Minimise the joint energy over people and the scale of the scene.

    One energy covers all people and the scale of the scene. A person with a non-finite start keeps it and is listed in
    ``failures``; the others are optimised without that person.

    Args:
        problem: placed people and their scene.
        progress: called with the completed share of the work, 0-1.

    Raises:
        PhysicError: inconsistent shapes, or the data of the depth term is missing.
    """
    problem.check()
    problem = problem.to_model_dtype()
    failures = [""] * len(problem)
    healthy = people_with_valid_start(problem)
    for i in (~healthy).nonzero().flatten().tolist():
        failures[i] = _INVALID_START
    energy: JointEnergy | None = None
    while healthy.any():
        rows = healthy.nonzero(as_tuple=True)[0]
        energy = JointEnergy(problem.select_people(rows), settings)
        finite = _finite_energy(energy)
        if finite.all():
            break
        for i in rows[~finite].tolist():
            failures[i] = _INVALID_ENERGY
        healthy[rows[~finite]] = False
        energy = None
    if energy is None:
        return _start_result(problem, tuple(failures))
    minimised = settings.minimise(energy, progress)
    return _merged_result(problem, energy, minimised, healthy.nonzero(as_tuple=True)[0], tuple(failures))


def _finite_energy(energy: JointEnergy) -> Tensor:
    """Return which people (B,) bool have finite terms and gradients."""
    people = len(energy.problem)
    energy_per_person = torch.stack([v for v in energy().values() if v.shape == (people,)])
    parameters = [energy.state.values[g] for g in energy.state.free if g != "scale"]
    gradients = torch.autograd.grad(energy_per_person.sum(), parameters, allow_unused=True) if parameters else ()
    fine = torch.isfinite(energy_per_person).all(0)
    for gradient in gradients:
        if gradient is not None:
            fine = fine & torch.isfinite(gradient).reshape(people, -1).all(1)
    return fine


@torch.no_grad()
def _start_result(problem: JointProblem, failures: tuple[str, ...]) -> JointResult:
    """Return the start as a result."""
    output = problem.model(problem.rotations0, problem.betas0, problem.transl0, problem.expression0)
    return JointResult(
        rotations=problem.rotations0,
        betas=problem.betas0,
        transl=problem.transl0,
        scene_scale=1.0,
        vertices=output.vertices,
        joints=output.joints,
        occluded=torch.zeros(output.vertices.shape[:2], dtype=torch.bool, device=output.vertices.device),
        depth_inside=torch.zeros_like(output.vertices[..., 0]),
        surface_share=torch.zeros_like(output.vertices[..., 0]),
        losses={},
        diagnostics=tuple({} for _ in failures),
        failures=failures,
        evaluations=0,
        steps=0,
    )


@torch.no_grad()
def _merged_result(
    problem: JointProblem, energy: JointEnergy, minimised: MinimisationResult, rows: Tensor, failures: tuple[str, ...]
) -> JointResult:
    """Return the optimised people, ``rows`` of all, together with the start of the others."""
    estimate = energy.state.unpack()
    start = _start_result(problem, failures)
    rotations, betas, transl = (
        initial.index_copy(0, rows, optimised)
        for initial, optimised in (
            (problem.rotations0, estimate.rotations),
            (problem.betas0, estimate.betas),
            (problem.transl0, estimate.transl),
        )
    )
    output = problem.model(rotations, betas, transl, problem.expression0)
    hidden = energy.occluded(output.vertices[rows])
    measured, depth, share = _diagnostics(energy, estimate, output.vertices[rows], hidden)
    everywhere, ids = torch.zeros_like(output.vertices[rows][..., 0]), energy.context.ids
    diagnostics: list[Mapping[str, float]] = [{} for _ in failures]
    for i, numbers in zip(rows.tolist(), measured, strict=True):
        diagnostics[i] = numbers
    return replace(
        start,
        rotations=rotations,
        betas=betas,
        transl=transl,
        scene_scale=float(estimate.log_scale.exp()),
        vertices=output.vertices,
        joints=output.joints,
        occluded=start.occluded.index_copy(0, rows, hidden),
        depth_inside=start.depth_inside.index_copy(0, rows, everywhere.index_copy(1, ids, depth)),
        surface_share=start.surface_share.index_copy(0, rows, everywhere.index_copy(1, ids, share)),
        losses={name: (minimised.start[name], minimised.end[name]) for name in minimised.end},
        diagnostics=tuple(diagnostics),
        evaluations=minimised.evaluations,
        steps=minimised.steps,
    )


def _diagnostics(
    energy: JointEnergy, estimate: Estimate, vertices: Tensor, hidden: Tensor
) -> tuple[list[dict[str, float]], Tensor, Tensor]:
    """Measure the result of each optimised person: name -> number; values that cannot be measured are left out.

    Returns the numbers, and of the tracked vertices (B, n) the depth inside scene or floor and the share of the visible
    surface.

    reprojection_px, reprojection_share: mean 2D error of confident keypoints, px and share of the stature in px.
    lowest_sole_m: height of the lower sole over the floor.
    penetration_share: share of the visible surface that lies over 3 cm inside the scene or under the floor.
    floating_m: gap between the body and the nearest surface; 0 in contact.
    depth_offset: log of the ratio of the depth map to the person's depth.
    occluded_share: share of vertices that are hidden by objects, other people or the own body.
    depth_order_share: share of vertices in front of a person who hides them in the photo.
    """
    problem, context = energy.problem, energy.context
    tracked = vertices[:, context.ids]
    error, confident = energy.reprojection_errors(estimate), context.keypoints.confident
    scale, visibility = float(estimate.log_scale.exp()), energy.visibility
    distance = update_contacts(context, visibility.normals, energy.scene, tracked, scale).signed
    height: Tensor | None = None
    if context.problem.floor_normal is not None:
        offset = tracked.new_tensor(problem.floor_offset * scale)
        height = plane_height(tracked, context.problem.floor_normal, offset)
    depth = torch.where(energy.weights["penetration"] > 0, torch.relu(-distance), 0.0)
    gap = torch.where(visibility.eligible, distance, torch.inf)
    if height is not None:
        depth = torch.where(visibility.eligible, torch.maximum(depth, torch.relu(-height)), depth)
        gap = torch.where(visibility.eligible, torch.minimum(gap, height), gap)
    seen = context.area * visibility.eligible
    share = seen / seen.sum(1, keepdim=True).clamp(min=torch.finfo(seen.dtype).tiny)
    behind = depth_order_violations(vertices, project(vertices, problem.K), problem.masks)
    people = []
    for i in range(len(problem)):
        numbers = {
            "occluded_share": float(hidden[i].float().mean()),
            "depth_order_share": float(behind[:, i].max()),
            "depth_offset": float(estimate.offset[i]),
        }
        if confident[i].any():
            numbers["reprojection_px"] = float(error[i][confident[i]].mean())
            numbers["reprojection_share"] = numbers["reprojection_px"] / float(context.person_px[i])
        if share[i].any():
            numbers["penetration_share"] = float((share[i] * (depth[i] > DEEP_M)).sum())
        if torch.isfinite(gap[i]).any():
            numbers["floating_m"] = max(0.0, float(gap[i].amin()))
        heights = [
            float(lowest_height(height[i : i + 1, sole]))
            for sole, foot in zip(context.soles, context.feet_visible[i].tolist(), strict=True)
            if height is not None and foot and len(sole)
        ]
        if heights:
            numbers["lowest_sole_m"] = min(heights)
        people.append(numbers)
    return people, depth, share
