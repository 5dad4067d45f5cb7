"""Build the result of a photo from estimates, solution, checks, and the weights and repositories of
the run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import torch

from physic_core.body.posture import photo_turned_deg
from physic_core.engine.floor_and_scale import scale_note
from physic_core.interfaces import Repository
from physic_core.pipeline.checks import (
    failed_checks,
    no_trust,
    person_trust,
    photo_trust,
    unknown_checks,
    warning_messages,
)
from physic_core.types import Grade, Person, Reconstruction
from physic_core.types.contacts import has_sole_on_floor
from physic_core.types.results import main_people
from physic_core.weights.lock import FileUse, lock_file_path, read_lock

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.configuration.model import Config
    from physic_core.configuration.resolve import ResolvedPipeline
    from physic_core.engine.state import Estimates
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
    trust = [
        person_trust(checks, i) if math.isfinite(stature) else no_trust(checks, i)
        for i, stature in enumerate(statures)
    ]
    of_photo = photo_trust(
        checks, [trust[i].probability for i in main_people(estimates.people.boxes)]
    )
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
                contact_probability=None
                if solution.contact_probability is None
                else solution.contact_probability[i],
                contact_partner=solution.contact_partner[i],
                contacts=solution.contacts[i],
                support=solution.supports[i],
                world_contact=solution.world_contact[i],
                failed_checks=failed_checks(checks, i),
                unknown_checks=unknown_checks(checks, i),
                grade=Grade.of(trust[i].probability),
                trust=trust[i].probability,
                why=trust[i].why,
                stature=statures[i] if math.isfinite(statures[i]) else None,
                stature_sigma=solution.people[i].size_sigma if math.isfinite(statures[i]) else None,
                age=None
                if estimates.ages is None or math.isnan(estimates.ages[i])
                else float(estimates.ages[i]),
            )
        )
    stages.warn(*warning_messages(checks))
    if estimates.scale_by_people and not estimates.known:
        bodies = sum(support is not None for support in solution.supports)
        stages.note(scale_note(solution.contacts, bodies, solution.scene.floor))
    stages.warn(*_small_people(estimates, solution))
    if degrees := photo_turned_deg(solution.joints, solution.scene.floor):
        stages.note(
            f"the people do not stand upright in the picture: is it turned by {degrees} degrees?"
        )
    return Reconstruction(
        image=estimates.image,
        intrinsics=solution.intrinsics,
        scene=solution.scene,
        people=tuple(people),
        faces=model.faces.int().numpy(),
        body_model=model.name,
        skeleton=estimates.keypoints.skeleton,
        stages=tuple(stages.records),
        diagnostics={**solution.diagnostics, "people": [asdict(p) for p in solution.people]},
        warnings=tuple(stages.warnings),
        notes=tuple(stages.notes),
        config=config.as_dict(),
        checks=checks,
        unposed=tuple(estimates.people.unposed),
        grade=Grade.of(of_photo),
        trust=of_photo,
        contact_partners=solution.partners,
    )


def _small_people(estimates: Estimates, solution: Solution) -> list[str]:
    """Return a warning about each person who stands on the floor of others and is too small."""
    on_floor = [has_sole_on_floor(contacts) for contacts in solution.contacts]
    return [
        f"person {i} would be {stature:.1f} m tall on the floor of the others: if this is a "
        f"child, give --age"
        for i, stature in estimates.small.items()
        if on_floor[i] and sum(on_floor) > 1
    ]


def describe_sources(
    plan: ResolvedPipeline, files: Mapping[str, FileUse]
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the entries "weights" and "repositories" of the diagnostics, and warnings.

    A repository's state is "tested" or "locked" if it is at the commit with which the backend was
    tested, or that of the lock file, "differs" if it is at another one, and "unpinned" if there is
    no such commit.

    Args:
        plan: the backends of the run.
        files: weight files that were loaded, by "set/file".
    """
    repositories: dict[str, FileUse] = {}
    for resolved in plan.backends.values():
        with suppress(Exception):  # of a plugin; the result is complete without its statement
            for one in resolved.backend.requirements():
                if isinstance(one, Repository) and one.found:
                    repositories[one.url] = {"commit": one.found, "state": _state(one)}
    entries = {"weights": dict(sorted(files.items())), "repositories": repositories}
    others = [
        f"weights {name} are not those of {lock_file_path()}"
        for name, use in files.items()
        if _differs(use)
    ]
    others += [
        f"the checkout of {url} is at {use['commit'][:7]}, not at the commit that was pinned"
        for url, use in repositories.items()
        if _differs(use)
    ]
    return {name: entry for name, entry in entries.items() if entry}, tuple(others)


def _differs(use: FileUse) -> bool:
    return use["state"] == "differs"


def _state(one: Repository) -> str:
    if one.commit:
        return "tested" if one.found.startswith(one.commit) else "differs"
    expected = read_lock().get(one.url, {}).get("commit")
    return "unpinned" if expected is None else "locked" if expected == one.found else "differs"
