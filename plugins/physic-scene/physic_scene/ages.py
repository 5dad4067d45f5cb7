"""Ages of the people of a moment: from the first photo to the others, and from the photos to the result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_core.errors import InputError
from physic_core.types import AgeEstimate, AgeEstimates

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import IntArray, Reconstruction
    from physic_scene.people import PersonOfScene
    from physic_scene.selection import ChosenPhotos, Photo

__all__ = ["ages_of_photos", "ages_of_scene", "check_ages"]


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


def ages_of_photos(ages: Sequence[float], chosen: ChosenPhotos, *, prompted: bool) -> dict[int, tuple[float, ...]]:
    """Return the ages of the people of each photo that shows people of known age, by the index of the photo.

    Args:
        ages: one per person of the first photo, years, 0 where unknown.
        chosen: who is who in the photos.
        prompted: whether people are in the order of the user's choice; else ages are from left to right.

    Raises:
        InputError: the first photo is left out.
    """
    first = chosen.first("ages")
    of_first = np.zeros(len(first.result.people))
    of_first[_order(first, prompted=prompted)] = ages
    found = {0: tuple(ages)}
    for v, photo in enumerate(chosen.photos[1:], 1):
        years = np.zeros(len(photo.result.people))
        for row in chosen.rows[(chosen.rows[:, [0, v]] >= 0).all(1)]:
            years[photo.people.rows[row[v]]] = of_first[first.people.rows[row[0]]]
        if years.any():
            found[photo.index] = tuple(years[_order(photo, prompted=prompted)].tolist())
    return found


def _order(photo: Photo, *, prompted: bool) -> IntArray:
    """Return the indices of the people of a photo in the order in which their ages are given."""
    boxes = np.array([person.box for person in photo.result.people], np.float64)
    return np.arange(len(boxes)) if prompted else np.argsort(boxes[:, 0] + boxes[:, 2], kind="stable")


def ages_of_scene(people: Sequence[PersonOfScene], photos: Sequence[Photo], model: BodyModel) -> AgeEstimates | None:
    """Return the ages of everybody in the result: the given ones, else what the photos alone found.

    Raises:
        InputError: two photos give one person different ages.
    """
    ages = [
        _age({photos[v].name: age for v, row in one.shown.items() if (age := photos[v].result.people[row].age)})
        for one in people
    ]
    if not any(ages):
        return None
    with torch.inference_mode():
        betas = torch.from_numpy(np.concatenate([one.parameters.betas for one in people])).double()
        stature = model.stature(betas).numpy()
    child = np.array([age is not None and age.years is not None for age in ages])
    values = [
        [np.nan if age is None or (x := getattr(age, name)) is None else x for age in ages]
        for name in ("child_probability", "years", "years_sigma", "stature_sigma")
    ]
    probability, years, years_sigma, stature_sigma = np.array(values, np.float64)
    return AgeEstimates(probability, years, years_sigma, np.where(child, stature, np.nan), stature_sigma)


def _age(by_photo: dict[str, AgeEstimate]) -> AgeEstimate | None:
    """Return the age of a person from that of each photo alone; None without any.

    A child of unknown age is one whom most of the photos take for a child.
    """
    given = {photo: age for photo, age in by_photo.items() if age.years_sigma == 0}
    if len({age.years for age in given.values()}) > 1:
        each = ", ".join(f"{age.years:g} in {photo}" for photo, age in given.items())
        raise InputError(f"one person was given different ages, in years: {each}; correct them")
    if given:
        return next(iter(given.values()))
    if not by_photo:
        return None
    ages = list(by_photo.values())
    probability = float(np.mean([age.child_probability for age in ages]))
    sigma = float(np.mean([age.stature_sigma for age in ages]))
    child = [(age.years, age.years_sigma) for age in ages if age.years is not None and age.years_sigma is not None]
    if 2 * len(child) <= len(ages):
        return AgeEstimate(probability, None, None, sigma)
    years, years_sigma = np.mean(child, axis=0).tolist()
    return AgeEstimate(probability, years, years_sigma, sigma)
