"""Stage 3: joint optimisation of people and scene (paper sec. 3.3, Eq. 5).

After it, inpainted points of the scene are moved out of the people.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.method import JointStageMethod
from physic_core.engine.joint.optimiser import MinimisationResult, Optimiser, join_results
from physic_core.engine.joint.term import Term
from physic_core.engine.joint.terms.people import SkinContactTerm
from physic_core.engine.scene.method import SceneStageMethod
from physic_core.engine.skin_contact import SkinContact
from physic_core.engine.state import Estimates, JointResult, State
from physic_core.geometry.pixels import span_of_true
from physic_core.geometry.pointmap import edge_ratio, pointmap_normals
from physic_core.geometry.visibility import move_out_of_bodies

_INVALID_START = "the start has non-finite parameters or is behind the camera"
_INVALID_ENERGY = "the energy of the start is not finite"

_OFF_KEYPOINTS = 4.0
"""Rise of a person's reprojection term that counts as off: one sure keypoint by two sigmas."""


def optimize(
    state: State, settings: JointStageMethod, progress: Callable[[float], None] | None = None
) -> State:
    """Minimise the joint energy over people and the scale of the scene.

    One energy covers all people and the scale of the scene. A person with a non-finite start keeps
    it and is listed in ``failures``; the others are optimised without that person.

    Args:
        state: placed people and their scene.
        settings: of stage 3.
        progress: called with the completed share of the work, 0-1.

    Raises:
        PhysicError: the data of the depth term is missing.
    """
    failures = [""] * len(state)
    healthy = _has_valid_start(state)
    for i in (~healthy).nonzero().flatten().tolist():
        failures[i] = _INVALID_START
    while healthy.any():
        rows = healthy.nonzero(as_tuple=True)[0]
        energy = JointEnergy(state.select_people(rows), settings)
        finite = _has_finite_energy(energy)
        if finite.all():
            break
        for i in rows[~finite].tolist():
            failures[i] = _INVALID_ENERGY
        healthy[rows[~finite]] = False
    else:
        return replace(state, joint=_unoptimised_result(state, failures))
    origin = energy.variables.pack()
    late, first, second = settings.late_terms(energy.sampling)
    minimised = first.minimise(energy, progress)
    minimised, released = _with_late_terms(energy, origin, minimised, late, second)
    result = _merged_people(state, energy, minimised, rows, failures)
    assert result.joint is not None
    released = tuple(
        contact._replace(person=int(rows[contact.person]), other=int(rows[contact.other]))
        for contact in released
    )
    return replace(result, joint=replace(result.joint, released=released))


def _with_late_terms(
    energy: JointEnergy,
    origin: Tensor,
    minimised: MinimisationResult,
    late: Sequence[Term],
    optimiser: Optimiser,
) -> tuple[MinimisationResult, tuple[SkinContact, ...]]:
    """Minimise the energy again with the late terms, and return the joined result, and the parts
    that were not pulled together: where that would move a person off the keypoints.
    """
    converged, own_terms = energy.variables.pack(), energy.terms
    misses = _reprojection(energy)
    released: tuple[SkinContact, ...] = ()
    while True:
        groups = energy.add_terms(late)
        if groups is None and not released:
            return minimised, released
        second_result = optimiser.minimise(energy, groups=groups)
        has_moved_keypoints = _reprojection(energy) - misses > _OFF_KEYPOINTS
        contacts = [
            contact
            for term in late
            if isinstance(term, SkinContactTerm)
            for contact in term.skin_contacts
        ]
        failed_contacts = [
            contact
            for contact in contacts
            if has_moved_keypoints[contact.person] or has_moved_keypoints[contact.other]
        ]
        if not failed_contacts:
            return join_results(energy, origin, minimised, second_result), released
        released += tuple(failed_contacts)
        late = [term for term in late if not isinstance(term, SkinContactTerm)]
        if kept_contacts := [
            contact
            for contact in contacts
            if not (has_moved_keypoints[contact.person] or has_moved_keypoints[contact.other])
        ]:
            late.append(SkinContactTerm(kept_contacts, energy.sampling))
        energy.terms = own_terms
        energy.variables.load(converged)
        energy.refresh()


@torch.no_grad()
def _reprojection(energy: JointEnergy) -> Tensor:
    """Return the energy (B,) of the keypoints of each person; 0 without such a term."""
    found = energy().get("reprojection")
    return energy.state.transl.new_zeros(len(energy.state)) if found is None else found


def _has_valid_start(state: State) -> Tensor:
    """Return which people (N,) bool have finite start parameters, and start in front of the camera
    that shows them.
    """
    fine = (state.transl[:, 2] > 0) | ~state.masks.flatten(1).any(1)
    for start in (state.rotations, state.betas, state.transl):
        fine = fine & torch.isfinite(start).flatten(1).all(1)
    return fine


def _has_finite_energy(energy: JointEnergy) -> Tensor:
    """Return which people (B,) bool have finite terms and gradients."""
    people = len(energy.state)
    energy_per_person = torch.stack([v for v in energy().values() if v.shape == (people,)])
    parameters = [energy.variables.values[g] for g in energy.variables.free if g != "scale"]
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
def _unoptimised_result(state: State, failures: list[str]) -> JointResult:
    """Return the bodies of a state, of which none was changed."""
    output = state.model(state.rotations, state.betas, state.transl, state.expression)
    unknown = torch.full_like(state.transl[:, 0], torch.nan)
    return JointResult(output.vertices, output.joints, unknown, tuple(failures))


@torch.no_grad()
def _merged_people(
    state: State,
    energy: JointEnergy,
    minimised: MinimisationResult,
    rows: Tensor,
    failures: list[str],
) -> State:
    """Return the optimised people, ``rows`` of all, together with the start of the others."""
    solution = energy.variables.unpack()
    optimised = replace(
        state,
        rotations=state.rotations.index_copy(0, rows, solution.rotations),
        betas=state.betas.index_copy(0, rows, solution.betas),
        transl=state.transl.index_copy(0, rows, solution.transl),
    )
    posed = _unoptimised_result(optimised, failures)
    joint = replace(
        posed,
        depth_offset=posed.depth_offset.index_copy(0, rows, solution.offset),
        scene_scale=float(solution.log_scale.exp()),
        losses={name: (minimised.start[name], minimised.end[name]) for name in minimised.end},
        evaluations=minimised.evaluations,
        steps=minimised.steps,
    )
    return replace(optimised, joint=joint)


def finalize_scene(estimates: Estimates, state: State, settings: SceneStageMethod) -> State:
    """Return the state with inpainted points of the scene moved out of the people.

    The scene's scale is not applied.
    """
    finite = state.finite_people
    if not settings.carve_m or not finite.any():
        return state
    scene = state.scene
    bodies = state.vertices[finite] / state.unapplied_scene_scale
    unseen = estimates.photo.hole & scene.valid
    masks = state.masks[finite][:, unseen]
    moved, still_inside = move_out_of_bodies(
        scene.points[unseen], bodies, state.model.faces, masks, settings.carve_m
    )
    if not still_inside.any():
        return state
    points = scene.points.clone()
    points[unseen] = moved
    changed = unseen.clone()
    changed[unseen] = still_inside
    rows, columns = (span_of_true(changed.any(dim), 1) for dim in (1, 0))
    ratio = edge_ratio(*unseen.shape)
    fresh = pointmap_normals(points[rows, columns], scene.valid[rows, columns], ratio)
    renewed = changed[rows, columns] & (fresh.square().sum(-1) > 0)
    surface = scene.normals.clone()
    surface[rows, columns] = torch.where(renewed[..., None], fresh, surface[rows, columns])
    return replace(state, scene=replace(scene, points=points, normals=surface))
