"""Build the result of a photo from the estimates, the solution of the engine, and the checks."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch

from physic_core.body.posture import photo_turned_deg
from physic_core.pipeline.checks import failed_checks, grade_person, grade_photo, unknown_checks, warning_messages
from physic_core.types import Person, Reconstruction
from physic_core.types.main_people import main_people

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.configuration.model import Config
    from physic_core.pipeline.estimate import Estimates
    from physic_core.pipeline.solution import Solution
    from physic_core.pipeline.stage_runner import StageRunner
    from physic_core.types import CheckResult


def build_reconstruction(
    estimates: Estimates,
    solution: Solution,
    checks: tuple[CheckResult, ...],
    model: BodyModel,
    config: Config,
    stages: StageRunner,
) -> Reconstruction:
    """Return the result of a photo; the messages of failed checks become warnings of the stages."""
    statures = model.stature(torch.as_tensor(solution.parameters.betas)).tolist()
    grades = [grade_person(checks, i) for i in range(len(estimates.people))]
    people = []
    for i in range(len(estimates.people)):
        people.append(
            Person(
                box=estimates.people.boxes[i],
                score=float(estimates.people.scores[i]),
                mask=estimates.people.masks[i],
                keypoints=estimates.keypoints.points[i],
                keypoint_confidence=estimates.keypoints.confidence[i],
                parameters=solution.parameters[i : i + 1],
                vertices=solution.vertices[i],
                joints=solution.joints[i],
                contact=solution.contact[i],
                distance=solution.distance[i],
                contact_probability=None if solution.contact_probability is None else solution.contact_probability[i],
                contact_partner=solution.contact_partner[i],
                contacts=solution.contacts[i],
                support=solution.supports[i],
                world_contact=solution.world_contact[i],
                failed_checks=failed_checks(checks, i),
                unknown_checks=unknown_checks(checks, i),
                grade=grades[i],
                stature=statures[i] if math.isfinite(statures[i]) else None,
                stature_sigma=solution.people[i]["size_sigma"] if math.isfinite(statures[i]) else None,
                age=None if estimates.ages is None or math.isnan(estimates.ages[i]) else float(estimates.ages[i]),
            )
        )
    stages.warn(*warning_messages(checks))
    if degrees := photo_turned_deg(solution.joints, solution.scene.floor):
        stages.note(f"the people do not stand upright in the picture: is it turned by {degrees} degrees?")
    return Reconstruction(
        image=estimates.image,
        intrinsics=solution.intrinsics,
        scene=solution.scene,
        people=tuple(people),
        faces=model.faces.int().numpy(),
        body_model=model.name,
        skeleton=estimates.keypoints.skeleton,
        stages=tuple(stages.records),
        diagnostics={**solution.diagnostics, "people": [dict(p) for p in solution.people]},
        warnings=tuple(stages.warnings),
        notes=tuple(stages.notes),
        config=config.as_dict(),
        checks=checks,
        unposed=tuple(estimates.people.unposed),
        grade=grade_photo(checks, [grades[i] for i in main_people(estimates.people.boxes)]),
        contact_partners=solution.partners,
    )
