"""Stage 3: joint optimisation of people and scene (paper sec. 3.3, Eq. 5).

After it, inpainted points of the scene are moved out of the people.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from physic_core.body.model import BodyOutput
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.method import JointMethod
from physic_core.engine.joint.optimiser import MinimisationResult, join_results
from physic_core.engine.joint.problem import JointProblem, JointResult, people_with_valid_start
from physic_core.engine.scene.method import SceneMethod
from physic_core.engine.scene.state import SceneState
from physic_core.geometry.pointmap import edge_ratio, pointmap_normals
from physic_core.geometry.visibility import move_behind_bodies

_INVALID_START = "the start has non-finite parameters or is behind the camera"
_INVALID_ENERGY = "the energy of the start is not finite"


def optimize(
    problem: JointProblem, settings: JointMethod, progress: Callable[[float], None] | None = None
) -> JointResult:
    """Minimise the joint energy over people and the scale of the scene.

    One energy covers all people and the scale of the scene. A person with a non-finite start keeps
    it and is listed in ``failures``; the others are optimised without that person.

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
    origin = energy.state.pack()
    minimised = settings.optimiser.minimise(energy, progress)
    late, optimiser = settings.late_terms(energy.context)
    groups = energy.add_terms(late)
    if groups is not None:
        minimised = join_results(
            energy, origin, minimised, optimiser.minimise(energy, groups=groups)
        )
    return _merged_result(
        problem, energy, minimised, healthy.nonzero(as_tuple=True)[0], tuple(failures)
    )


def _finite_energy(energy: JointEnergy) -> Tensor:
    """Return which people (B,) bool have finite terms and gradients."""
    people = len(energy.problem)
    energy_per_person = torch.stack([v for v in energy().values() if v.shape == (people,)])
    parameters = [energy.state.values[g] for g in energy.state.free if g != "scale"]
    gradients = (
        torch.autograd.grad(energy_per_person.sum(), parameters, allow_unused=True)
        if parameters
        else ()
    )
    fine = torch.isfinite(energy_per_person).all(0)
    for gradient in gradients:
        if gradient is not None:
            fine = fine & torch.isfinite(gradient).reshape(people, -1).all(1)
    return fine


@torch.no_grad()
def _start_result(
    problem: JointProblem, failures: tuple[str, ...], output: BodyOutput | None = None
) -> JointResult:
    """Return the start as a result, with the vertices and joints of ``output`` if it is given."""
    if output is None:
        output = problem.model(
            problem.rotations0, problem.betas0, problem.transl0, problem.expression0
        )
    return JointResult(
        rotations=problem.rotations0,
        betas=problem.betas0,
        transl=problem.transl0,
        scene_scale=1.0,
        vertices=output.vertices,
        joints=output.joints,
        depth_offset=torch.full_like(problem.transl0[:, 0], torch.nan),
        losses={},
        failures=failures,
        evaluations=0,
        steps=0,
    )


@torch.no_grad()
def _merged_result(
    problem: JointProblem,
    energy: JointEnergy,
    minimised: MinimisationResult,
    rows: Tensor,
    failures: tuple[str, ...],
) -> JointResult:
    """Return the optimised people, ``rows`` of all, together with the start of the others."""
    estimate = energy.state.unpack()
    rotations, betas, transl = (
        initial.index_copy(0, rows, optimised)
        for initial, optimised in (
            (problem.rotations0, estimate.rotations),
            (problem.betas0, estimate.betas),
            (problem.transl0, estimate.transl),
        )
    )
    output = problem.model(rotations, betas, transl, problem.expression0)
    start = _start_result(problem, failures, output)
    return replace(
        start,
        rotations=rotations,
        betas=betas,
        transl=transl,
        scene_scale=float(estimate.log_scale.exp()),
        depth_offset=start.depth_offset.index_copy(0, rows, estimate.offset),
        losses={name: (minimised.start[name], minimised.end[name]) for name in minimised.end},
        evaluations=minimised.evaluations,
        steps=minimised.steps,
    )


def finalize_scene(
    scene: SceneState,
    problem: JointProblem,
    result: JointResult,
    hole: Tensor,
    settings: SceneMethod,
) -> tuple[SceneState, JointProblem]:
    """Return the scene after the joint optimisation, and the problem with the points and the depth
    of that scene.

    The scene's scale is not applied. Inpainted points inside people are moved out.

    Args:
        hole: (H, W) bool, inpainted pixels.
    """
    s = result.scene_scale
    finite = torch.isfinite(result.vertices).flatten(1).all(1)
    if settings.carve_m and bool(finite.any()):
        scene = _carved(
            scene,
            result.vertices[finite] / s,
            problem.model.faces,
            problem.masks[finite],
            hole,
            settings,
        )
    points, normals = scene.surface
    problem = replace(
        problem,
        scene_points=points.to(problem.scene_points),
        scene_normals=normals.to(problem.scene_normals),
        scene_depth=None if problem.scene_depth is None else scene.depth.to(problem.scene_depth),
    )
    return scene, problem


def _carved(
    scene: SceneState,
    bodies: Tensor,
    faces: Tensor,
    masks: Tensor,
    hole: Tensor,
    settings: SceneMethod,
) -> SceneState:
    """Move inpainted scene points out of the bodies (B, V, 3) that occluded them."""
    unseen = hole & scene.valid
    moved, out = move_behind_bodies(
        scene.points[unseen], bodies, faces, masks[:, unseen], settings.carve_m
    )
    points = scene.points.clone()
    points[unseen] = moved
    changed = unseen.clone()
    changed[unseen] = out
    if not bool(out.any()):
        return scene
    rows, columns = (_span(changed.any(dim)) for dim in (1, 0))
    ratio = edge_ratio(*hole.shape)
    fresh = pointmap_normals(points[rows, columns], scene.valid[rows, columns], ratio)
    renewed = changed[rows, columns] & (fresh.square().sum(-1) > 0)
    surface = scene.normals.clone()
    surface[rows, columns] = torch.where(renewed[..., None], fresh, surface[rows, columns])
    return replace(scene, points=points, normals=surface)


def _span(hit: Tensor) -> slice:
    """Return the span of the true elements of ``hit`` (n,) with one neighbour on each side."""
    at = hit.nonzero()
    return slice(max(0, int(at[0]) - 1), int(at[-1]) + 2)
