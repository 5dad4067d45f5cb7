"""Run the engine on the backends' results: its four stages in order. OpenCV camera frame, metres."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.posture import standing_legs
from physic_core.engine.contact.solve import solve_contact
from physic_core.engine.joint.final_scene import finalize_scene
from physic_core.engine.joint.solve import optimize
from physic_core.engine.placement.solve import solve_placement
from physic_core.engine.scene.solve import solve_scene
from physic_core.engine.sizes import log_growth_to_floor
from physic_core.pipeline.checks.specs import CHECKS
from physic_core.pipeline.engine_input import (
    contact_input,
    engine_input,
    joint_problem,
    placement_input,
    sized_scene,
)
from physic_core.pipeline.known_sizes import (
    check_people_in_scene,
    compare_statures,
    contradictions,
    floor_contradiction,
)
from physic_core.pipeline.solution import Solution, assemble_solution, scene_alone
from physic_core.types.known_sizes import KnownPeople

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.engine.placement.solve import EstimatedBodies, PlacedPeople
    from physic_core.engine.settings import EngineSettings
    from physic_core.engine.sizes import KnownScene
    from physic_core.pipeline.estimate import Estimates
    from physic_core.pipeline.stage_runner import StageRunner
    from physic_core.types import FloatArray

_EXACT_SCALE_SIGMA = 0.01  # of the log scale of a scene that the user's sizes have scaled


def run_engine(estimates: Estimates, settings: EngineSettings, model: BodyModel, stages: StageRunner) -> Solution:
    """Run scene, placement, joint optimisation and contact on the device of the body model.

    Without people, the scene is the result. The pipeline uses the CPU, since nearest-point search and ray casts run
    there.
    """
    # Eighty L-BFGS steps amplify rounding errors a million times: float32 results would differ between CPUs.
    model = model.double
    with stages.time_engine("scene"):
        given = engine_input(estimates, model)
        scene = solve_scene(given.scene, settings.scene)
        known = sized_scene(estimates, given.detections.masks, scene)
        scene = scene if known is None else known.scene
    is_sized = known is not None and known.factor is not None
    if estimates.scale_guess and not is_sized:
        stages.warn(estimates.scale_guess)
    scale_sigma = _EXACT_SCALE_SIGMA if is_sized else estimates.depth.scale_sigma
    if not len(estimates.people):
        return scene_alone(estimates, scene, model, scale_sigma)
    with stages.time_engine("placement"):
        placed = solve_placement(placement_input(given, scene, known), settings.placement)
        if known is not None:
            stages.warn(*_size_warnings(estimates, known, given.bodies, placed))
    with stages.time_engine("joint optimisation"):
        problem = joint_problem(given, placed, known, scale_sigma, estimates.views)
        # Without a common background the depth of people is unknown; a warning reports it.
        blind = problem.human_depth is None
        result = optimize(problem, settings.joint.without("depth") if blind else settings.joint)
    with stages.time_engine("contact"):
        scene, problem = finalize_scene(placed.scene, problem, result, given.photo.people, settings.scene)
        warnings, measured = contradictions(estimates.known, scene, problem, result)
        stages.warn(*warnings)
        touch = solve_contact(contact_input(given, scene, problem, result, settings.contact), settings.contact)
        solution = assemble_solution(estimates, scene, problem, placed, result, touch)
        people = solution.people
        if estimates.known:
            said = KnownPeople(estimates.ages, estimates.statures)
            sizes = compare_statures(said, problem, result, _off_floor(solution), is_sized=is_sized)
            people = tuple({**own, **size} for own, size in zip(people, sizes, strict=True))
        return replace(solution, people=people, diagnostics={**solution.diagnostics, **measured})


def _off_floor(solution: Solution) -> FloatArray:
    """Return the log factor (N,) by which people who stand off the floor must grow to stand on it; 0 for others."""
    found, floor = np.zeros(len(solution.people)), solution.scene.floor
    for i, report in enumerate(solution.people):
        height = report.get("sole_height_m")
        if floor is None or height is None or abs(height) <= CHECKS["sole_height"].threshold:
            continue
        if standing_legs(solution.joints[i]).all():
            found[i] = log_growth_to_floor(height, floor.offset)
    return found


def _size_warnings(estimates: Estimates, known: KnownScene, bodies: EstimatedBodies, placed: PlacedPeople) -> list[str]:
    """Return warnings of people who do not fit the known sizes; raise if the photo contradicts these."""
    warnings = []
    if placed.size_ratio is not None:
        estimated = bodies.model.stature(bodies.betas)
        warnings = check_people_in_scene(known.geometry, estimates.statures, estimated, placed.size_ratio)
    if placed.rejected_floor is not None and known.geometry.camera_height is not None:
        raise floor_contradiction(known.geometry, known.unscaled.floor_offset)
    return warnings
