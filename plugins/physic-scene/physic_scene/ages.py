"""Known ages of the people of a moment: from the first photo to the others, and from the photos to the result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError

if TYPE_CHECKING:
    from physic_core.types import FloatArray, IntArray, Reconstruction
    from physic_scene.people import PersonOfScene
    from physic_scene.photos import ScenePhoto
    from physic_scene.solution import SolvedScene


def check_ages(ages: Sequence[float], photo: str, result: Reconstruction | None) -> None:
    """Check that several ages are as many as the people of the first photo.

    Raises:
        InputError: they are not.
    """
    count = 0 if result is None else len(result.people)
    if len(ages) > 1 and len(ages) != count:
        raise InputError(
            f"{len(ages)} ages were given, but {count} {'person was' if count == 1 else 'people were'} found in "
            f"{photo}, the first photo: give one age for all, or one per person of it from left to right with 0 where "
            "it is unknown"
        )


def ages_of_photos(ages: Sequence[float], solved: SolvedScene, *, prompted: bool) -> dict[int, tuple[float, ...]]:
    """Return the ages of the people of each photo that shows people of known age, by the index of the photo.

    Args:
        ages: one per person of the first photo, years, 0 where unknown.
        solved: who is who in the photos.
        prompted: whether people are in the order of the user's choice; else ages are from left to right.

    Raises:
        InputError: the first photo is skipped.
    """
    first = solved.first("ages")
    of_first = np.zeros(len(first.result.people))
    of_first[_order(first, prompted=prompted)] = ages
    found = {0: tuple(ages)}
    for v, photo in enumerate(solved.photos[1:], 1):
        years = np.zeros(len(photo.result.people))
        for row in solved.rows[(solved.rows[:, [0, v]] >= 0).all(1)]:
            years[photo.rows[row[v]]] = of_first[first.rows[row[0]]]
        if years.any():
            found[photo.index] = tuple(years[_order(photo, prompted=prompted)].tolist())
    return found


def _order(photo: ScenePhoto, *, prompted: bool) -> IntArray:
    """Return the indices of the people of a photo in the order in which their ages are given."""
    boxes = np.array([person.box for person in photo.result.people], np.float64)
    return np.arange(len(boxes)) if prompted else np.argsort(boxes[:, 0] + boxes[:, 2], kind="stable")


def ages_of_scene(people: Sequence[PersonOfScene], photos: Sequence[ScenePhoto]) -> FloatArray | None:
    """Return the known age (P,) of everybody in the result, years, NaN where unknown; None if no age is known.

    Raises:
        InputError: two photos give one person different ages.
    """
    ages = np.full(len(people), np.nan)
    for i, person in enumerate(people):
        given = {photos[v].name: age for v, row in person.shown.items() if (age := photos[v].result.people[row].age)}
        if len(set(given.values())) > 1:
            each = ", ".join(f"{age:g} in {photo}" for photo, age in given.items())
            raise InputError(f"one person was given different ages, in years: {each}; correct them")
        ages[i] = next(iter(given.values()), np.nan)
    return ages if np.isfinite(ages).any() else None
