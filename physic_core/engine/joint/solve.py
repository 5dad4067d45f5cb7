"""Stage 3: joint optimisation of people and scene (paper sec. 3.3, Eq. 5), with diagnostics for each person."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import torch
from torch import Tensor

from physic_core.engine.joint.distances import lowest_height, plane_height, signed_distance
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.local_depth_scale import warp_share
from physic_core.engine.joint.optimiser import Trace
from physic_core.engine.joint.problem import JointProblem, JointResult, finite_people
from physic_core.engine.joint.schedule import run
from physic_core.engine.joint.settings import JointSettings
from physic_core.engine.joint.state import Estimate
from physic_core.geometry.camera import project
from physic_core.geometry.visibility import depth_order_violations

__all__ = ["JointProblem", "JointResult", "optimize"]

_DEEP_M = 0.03  # deeper vertices are a visible error

_NOT_FINITE = "the start is not made of numbers, or lies behind the camera"
_NO_ENERGY = "the energy of the start is not a number"


def optimize(
    problem: JointProblem, settings: JointSettings, progress: Callable[[float], None] | None = None
) -> JointResult:
    """Minimise the joint energy over people and scene.

    One energy covers all people and the scale of the scene. A person with a non-finite start keeps it and is listed in
    ``failures``; the others are optimised without that person.

    Args:
        problem: placed people and their scene.
        settings: of stage 3.
        progress: called with the completed share of the work, 0-1.

    Raises:
        PhysicError: inconsistent shapes, or a depth term without its data.
    """
    problem.check()
    problem = problem.as_model()
    failures = [""] * len(problem)
    healthy = finite_people(problem)
    for i in (~healthy).nonzero().flatten().tolist():
        failures[i] = _NOT_FINITE
    energy: JointEnergy | None = None
    while healthy.any():
        rows = healthy.nonzero(as_tuple=True)[0]
        energy = JointEnergy(problem.pick(rows), settings)
        finite = _finite_energy(energy)
        if finite.all():
            break
        for i in rows[~finite].tolist():
            failures[i] = _NO_ENERGY
        healthy[rows[~finite]] = False
        energy = None
    if energy is None:
        return _untouched(problem, tuple(failures))
    trace = run(energy, settings, progress)
    return _result(problem, energy, trace, healthy.nonzero(as_tuple=True)[0], tuple(failures))


def _finite_energy(energy: JointEnergy) -> Tensor:
    """(B,) bool: people whose terms and gradients are all finite."""
    people = len(energy.problem)
    per_person = torch.stack([v for v in energy().values() if v.shape == (people,)])
    parameters = [energy.state.values[g] for g in energy.state.free if g != "scale"]
    gradients = torch.autograd.grad(per_person.sum(), parameters, allow_unused=True) if parameters else ()
    fine = torch.isfinite(per_person).all(0)
    for gradient in gradients:
        if gradient is not None:
            fine = fine & torch.isfinite(gradient).reshape(people, -1).all(1)
    return fine


@torch.no_grad()
def _untouched(problem: JointProblem, failures: tuple[str, ...]) -> JointResult:
    output = problem.model(problem.rotations0, problem.betas0, problem.transl0, problem.expression0)
    return JointResult(
        rotations=problem.rotations0,
        betas=problem.betas0,
        transl=problem.transl0,
        scene_scale=1.0,
        warp=torch.zeros_like(problem.transl0[:, 0]),
        vertices=output.vertices,
        joints=output.joints,
        occluded=torch.zeros(output.vertices.shape[:2], dtype=torch.bool, device=output.vertices.device),
        losses={},
        diagnostics=tuple({} for _ in failures),
        failures=failures,
        evaluations=0,
        steps=0,
    )


@torch.no_grad()
def _result(
    problem: JointProblem, energy: JointEnergy, trace: Trace, rows: Tensor, failures: tuple[str, ...]
) -> JointResult:
    """Merge the optimised people with those who were left out."""
    estimate = energy.state.unpack()
    start = _untouched(problem, failures)
    rotations, betas, transl = (
        whole.index_copy(0, rows, part)
        for whole, part in (
            (problem.rotations0, estimate.rotations),
            (problem.betas0, estimate.betas),
            (problem.transl0, estimate.transl),
        )
    )
    output = problem.model(rotations, betas, transl, problem.expression0)
    hidden = energy.occluded(output.vertices[rows])
    measured = _diagnostics(energy, estimate, output.vertices[rows], hidden)
    diagnostics: list[Mapping[str, float]] = [{} for _ in failures]
    for i, numbers in zip(rows.tolist(), measured, strict=True):
        diagnostics[i] = numbers
    return replace(
        start,
        rotations=rotations,
        betas=betas,
        transl=transl,
        scene_scale=float(estimate.log_scale.exp()),
        warp=start.warp.index_copy(0, rows, estimate.warp),
        vertices=output.vertices,
        joints=output.joints,
        occluded=start.occluded.index_copy(0, rows, hidden),
        losses={name: (trace.start[name], trace.end[name]) for name in trace.end},
        diagnostics=tuple(diagnostics),
        evaluations=trace.evaluations,
        steps=trace.steps,
    )


def _diagnostics(energy: JointEnergy, estimate: Estimate, vertices: Tensor, hidden: Tensor) -> list[dict[str, float]]:
    """One dict of numbers per optimised person; values that could not be measured are left out.

    reprojection_px, reprojection_share: mean 2D error of confident keypoints, px and share of the stature in px.
    lowest_sole_m: height of the lower sole over the floor.
    penetration_share: share of the visible surface that lies over 3 cm inside the scene or under the floor.
    floating_m: gap between the body and the nearest surface; 0 where it touches.
    depth_offset: log of the ratio of the depth map to the person's depth.
    warp: log of the local depth scale near the person, relative to the scene's scale.
    occluded_share: share of vertices that objects, other people or the own body hide.
    depth_order_share: share of vertices in front of a person who hides them in the photo.
    """
    problem, context = energy.problem, energy.context
    tracked = vertices[:, context.ids]
    posed = context.pose(estimate.rotations, estimate.betas, estimate.transl, problem.expression0)
    error = (project(posed[problem.skeleton], problem.K) - context.keypoints.points).norm(dim=-1)
    confident = context.keypoints.confident
    scale = float(estimate.log_scale.exp())
    scene, visibility = energy.scene, energy.visibility
    warp = estimate.warp[:, None]
    near = scene.query(tracked / warp.exp()[..., None], scale)
    distance = torch.full_like(context.area, torch.inf)
    if len(scene.points):
        points = scene.points[near.index]
        factor = scale * torch.exp(warp * warp_share(points, problem.floor_normal, problem.floor_offset))
        signed = signed_distance(tracked, points * factor[..., None], scene.normals[near.index])
        distance = torch.where(near.found, signed, distance)
    height: Tensor | None = None
    if problem.floor_normal is not None and context.conventions.floor != "ignored":
        offset = tracked.new_tensor(problem.floor_offset * scale)
        height = plane_height(tracked, problem.floor_normal, offset)
    counted = (energy.active["penetration"] > 0) & (distance < -_DEEP_M)
    gap = torch.where(visibility.in_play, distance, torch.inf)
    if height is not None:
        counted = counted | (visibility.in_play & (height < -_DEEP_M))
        gap = torch.where(visibility.in_play, torch.minimum(gap, height), gap)
    behind = depth_order_violations(vertices, project(vertices, problem.K), problem.masks)
    people = []
    for i in range(len(problem)):
        numbers = {
            "occluded_share": float(hidden[i].float().mean()),
            "depth_order_share": float(behind[:, i].max()),
            "depth_offset": float(estimate.offset[i]),
            "warp": float(estimate.warp[i]),
        }
        if confident[i].any():
            numbers["reprojection_px"] = float(error[i][confident[i]].mean())
            numbers["reprojection_share"] = numbers["reprojection_px"] / float(context.person_px[i])
        seen = context.area[i] * visibility.in_play[i]
        if seen.sum() > 0:
            numbers["penetration_share"] = float((seen * counted[i]).sum() / seen.sum())
        if torch.isfinite(gap[i]).any():
            numbers["floating_m"] = max(0.0, float(gap[i].amin()))
        heights = [
            float(lowest_height(height[i : i + 1, sole]))
            for sole, foot in zip(context.soles, context.feet_seen[i].tolist(), strict=True)
            if height is not None and foot and len(sole)
        ]
        if heights:
            numbers["lowest_sole_m"] = min(heights)
        people.append(numbers)
    return people
