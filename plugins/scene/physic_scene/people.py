"""All people of the result: those of the reference photo, then those whom only other photos
show.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_core.body import parameters_from_rotations
from physic_core.types import ShortRepr
from physic_scene.person_matching import compare_places

if TYPE_CHECKING:
    from physic_core.body import BodyModel
    from physic_core.types import BodyParameters
    from physic_scene.solution import SolvedScene


_SAME_PLACE = 0.3  # distance of two people who may be one, over their distance from the cameras


@dataclass(frozen=True)
class PersonOfScene(ShortRepr):
    """One person of the result; photos are indices into ``SolvedScene.photos``.

    Attributes:
        row_by_photo: photo -> index in its result, of the photos that show this body.
        parameters: body before the joint solution, in the reference frame, metres; a batch of one.
        stature: known one, metres; NaN where unknown.
    """

    row_by_photo: Mapping[int, int]
    parameters: BodyParameters
    stature: float = np.nan


def people_of_scene(solved: SolvedScene, model: BodyModel) -> tuple[PersonOfScene, ...]:
    """Return the people in the order of the result.

    A person whom only one photo shows, and not the reference, is in the result if no other photo
    shows a similar person in the same place, who may be the same one.
    """
    reference = solved.reference
    photos = solved.photos
    matched = [
        PersonOfScene(
            {v: photos[v].rows[row[v]] for v in np.flatnonzero(row >= 0).tolist()},
            solved.bodies.parameters([p], model),
            solved.statures[p],
        )
        for p, row in enumerate(solved.rows)
    ]
    in_reference = {one.row_by_photo.get(reference): one for one in matched}
    reference_people = [
        in_reference.get(i) or PersonOfScene({reference: i}, person.parameters)
        for i, person in enumerate(photos[reference].result.people)
    ]
    others = [one for one in matched if reference not in one.row_by_photo]
    return (*reference_people, *others, *_people_of_one_photo(solved, model))


def _people_of_one_photo(solved: SolvedScene, model: BodyModel) -> Iterator[PersonOfScene]:
    """Yield people whom only one photo shows, not the reference, and who resemble no other
    person.
    """
    photos = solved.photos
    accepted: list[tuple[int, int]] = []
    for v, photo in enumerate(photos):
        if v == solved.reference:
            continue
        for row in np.setdiff1d(np.arange(len(photo.people)), solved.rows[:, v]).tolist():
            if not any(
                _may_be_same(solved, (v, row), w, accepted) for w in range(len(photos)) if w != v
            ):
                yield PersonOfScene({v: photo.rows[row]}, _parameters_alone(solved, v, row, model))
                accepted.append((v, row))


def _may_be_same(
    solved: SolvedScene, person: tuple[int, int], other: int, accepted: Sequence[tuple[int, int]]
) -> bool:
    """Return whether another photo has a person in the place of a person (photo, row).

    People whom both photos show do not count, since they are others. Of people whom only the other
    photo shows, those of the reference photo and accepted ones count, since the others are not in
    the result.
    """
    known = solved.rows
    v, row = person
    first_people, second_people = (solved.photos[view].people for view in (v, other))
    in_both = known[(known[:, v] >= 0) & (known[:, other] >= 0), other]
    in_result = (
        set(range(len(second_people)))
        if other == solved.reference
        else {r for w, r in accepted if w == other}
    )
    candidates = [
        j for j in in_result | set(known[known[:, other] >= 0, other].tolist()) if j not in in_both
    ]
    motion = solved.bundle.pose(other).after(solved.bundle.pose(v).inverse())
    place_cost = compare_places(first_people, second_people, motion)
    return bool((place_cost[row, candidates] < _SAME_PLACE).any())


def _parameters_alone(solved: SolvedScene, view: int, row: int, model: BodyModel) -> BodyParameters:
    """Return the body of a single photo in the reference frame, at the distance of the solved focal
    length.
    """
    photo = solved.photos[view]
    pose = solved.bundle.pose(view)
    people = photo.people
    if view == solved.reference:
        return photo.result.people[photo.rows[row]].parameters
    rotations = people.rotations[row : row + 1].copy()
    rotations[:, 0] = pose.rotation.T @ rotations[:, 0]
    turned = torch.from_numpy(rotations)
    betas = torch.from_numpy(people.betas[row : row + 1])
    pelvis = pose.to_common(people.joints[row, 0] * [1, 1, np.exp(solved.bundle.log_focal[view])])
    with torch.inference_mode():
        transl = torch.from_numpy(pelvis) - model(turned, betas, betas.new_zeros(1, 3)).joints[:, 0]
    return parameters_from_rotations(
        turned, betas, betas.new_zeros(1, model.num_expression), transl.clone()
    )
