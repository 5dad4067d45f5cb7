"""Run the engine on the backends' results: its four stages in order.

OpenCV camera frame, metres.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.engine.contact.solve import solve_contact
from physic_core.engine.joint.solve import finalize_scene, optimize
from physic_core.engine.placement.solve import PlacementInput, solve_placement
from physic_core.engine.scene.solve import solve_scene
from physic_core.pipeline.engine_input import (
    contact_input,
    engine_input,
    joint_problem,
    sized_scene,
)
from physic_core.pipeline.solution import Solution, assemble_solution, scene_alone

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.engine.settings import EngineSettings
    from physic_core.pipeline.estimate import Estimates
    from physic_core.pipeline.stage_runner import StageRunner


def run_engine(
    estimates: Estimates, settings: EngineSettings, model: BodyModel, stages: StageRunner
) -> Solution:
    """Run scene, placement, joint optimisation and contact on the device of the body model.

    Without people, the scene is the result. The pipeline uses the CPU, since nearest-point search
    and ray casts run there.
    """
    # Eighty L-BFGS steps amplify rounding errors a million times: float32 results would differ
    # between CPUs.
    model = model.double
    with stages.time_engine("scene"):
        given = engine_input(estimates, model)
        scene = solve_scene(given.scene, settings.scene)
        known = sized_scene(estimates, given.detections.masks, scene)
        scene = scene if known is None else known.scene
    sized = None if known is None else known.evidence
    if estimates.scale_guess and sized is None:
        stages.warn(estimates.scale_guess)
    scale_sigma = estimates.depth.scale_sigma if sized is None else sized.sigma
    if not len(estimates.people):
        return scene_alone(estimates, scene, model, scale_sigma)
    with stages.time_engine("placement"):
        where = PlacementInput(
            scene, given.photo, given.bodies, given.detections, known, given.stance
        )
        placed = solve_placement(where, settings.placement)
        if known is not None:
            from physic_core.pipeline.known_sizes import check_placed_people

            stages.warn(*check_placed_people(estimates, known, given.bodies, placed))
    with stages.time_engine("joint optimisation"):
        problem = joint_problem(given, placed, known, scale_sigma, estimates.views)
        # Without a common background the depth of people is unknown; a warning reports it.
        blind = problem.human_depth is None
        result = optimize(problem, settings.joint.without("depth") if blind else settings.joint)
    with stages.time_engine("contact"):
        # Before inpainted points are moved out of people: what carries them is there.
        touch = solve_contact(
            contact_input(given, placed.scene, problem, result, settings.contact), settings.contact
        )
        scene, problem = finalize_scene(
            placed.scene, problem, result, given.photo.people, settings.scene
        )
        solution = assemble_solution(estimates, scene, problem, placed, result, touch)
    if not estimates.known:
        return solution
    from physic_core.pipeline.known_sizes import compare_sizes

    warnings, solution = compare_sizes(
        estimates, solution, scene, problem, result, is_sized=sized is not None
    )
    stages.warn(*warnings)
    return solution
