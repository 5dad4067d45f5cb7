"""Run the engine on the backends' results: its four stages in order.

OpenCV camera frame, metres.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from physic_core.engine.contact.solve import solve_contact
from physic_core.engine.joint.solve import finalize_scene, optimize
from physic_core.engine.measures import measure_agreement
from physic_core.engine.placement.solve import solve_placement
from physic_core.engine.scene.solve import solve_scene
from physic_core.pipeline.reconstruction import as_reconstruction
from physic_core.types.contacts import part_words

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.engine.settings import EngineSettings
    from physic_core.engine.skin_contact import SkinContact
    from physic_core.engine.state import Estimates
    from physic_core.pipeline.stage_caller import StageCaller
    from physic_core.types import Reconstruction


def run_engine(
    estimates: Estimates, settings: EngineSettings, model: BodyModel, stages: StageCaller
) -> Reconstruction:
    """Run scene, placement, joint optimisation and contact.

    Without people, the scene is the result. Checks and records of the run are not yet in it. The
    pipeline uses the CPU, since nearest-point search and ray casts run there.
    """
    # Eighty L-BFGS steps amplify rounding errors a million times: float32 results would differ
    # between CPUs.
    model = model.double
    with stages.time_engine("scene"):
        state = solve_scene(estimates, model, settings.scene)
    is_sized = state.known is not None and state.known.unscaled is not None
    if estimates.ground.guess_warning and not is_sized:
        stages.warn(estimates.ground.guess_warning)
    if not len(estimates.photo.people):
        return as_reconstruction(estimates, state)
    with stages.time_engine("placement"):
        placed = solve_placement(estimates, state, settings.placement)
        if placed.size_ratio is not None:
            from physic_core.judge.sizes import check_placed_people

            stages.warn(*check_placed_people(estimates, state, placed))
    with stages.time_engine("joint optimization"):
        # Without a common background the depth of people is unknown; a warning reports it.
        blind = placed.photo_depth is None
        state = optimize(placed, settings.joint.without("depth") if blind else settings.joint)
    if state.joint is not None:
        stages.note(*(_separation_note(one) for one in state.joint.released))
    with stages.time_engine("contact"):
        # Before inpainted points are moved out of people: what carries them is there.
        contact = solve_contact(estimates, state, settings.contact).contact
        state = finalize_scene(estimates, replace(state, contact=contact), settings.scene)
        measures = measure_agreement(estimates, state)
    if not estimates.known:
        return as_reconstruction(estimates, state, measures)
    from physic_core.judge.sizes import compare_sizes

    warnings, measures, sizes = compare_sizes(estimates, measures, placed, state)
    stages.warn(*warnings)
    result = as_reconstruction(estimates, state, measures)
    return replace(result, diagnostics={**result.diagnostics, **sizes})


def _separation_note(contact: SkinContact) -> str:
    """Return the note on two parts that the engine did not bring together."""
    own, other = part_words(contact.part), part_words(contact.other_part)
    whose = "the same" if contact.other == contact.person else f"person {contact.other}"
    return (
        f"the {own} of person {contact.person} probably touches the {other} of {whose}, "
        "but they stay apart in the result, because contact would move a body off its keypoints. "
        "Do not measure the gap between them"
    )
