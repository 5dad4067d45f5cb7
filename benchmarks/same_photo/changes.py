"""Changes between the answer to a photo and the answer to its variant, and their table."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.metrics import match_by_masks

from .variants import GRID

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .variants import Answer, SeenPerson

LARGEST = 4
"""People of a photo who count, by the area of their masks: otherwise a crowd would count more than
all other photos.
"""

LEAST_VISIBLE = 0.5
"""Share of a person that a variant must show so that the person counts."""

UNSURE = 0.1, 0.9
"""Probabilities between which a body part counts as unsure."""


@dataclass(frozen=True)
class PersonChange:
    """Change of one person.

    Attributes:
        person: rank among the photo's people, the largest first.
        distance: logarithm of the ratio of the distances.
        sigmas: the same over the stated sigma; NaN if none is stated.
        parts: probabilities of each body part in both answers.
        usable: marks that are usable in both answers.
        trust: difference of the probabilities that the person is right; NaN without checks.
    """

    person: int
    distance: float
    sigmas: float
    parts: tuple[tuple[float, float], ...]
    usable: tuple[tuple[str, ...], tuple[str, ...]]
    trust: float


@dataclass(frozen=True)
class Change:
    """Change of an answer; NaN for what one of the answers lacks.

    Attributes:
        people: who are in both answers.
        visible: number of the photo's largest people of whom the variant shows enough.
        lost: of these, people whom the variant's answer lacks.
        new: of the variant's largest people, those whom the photo's answer lacks.
        scene: logarithm of the median ratio of the depths.
    """

    people: tuple[PersonChange, ...]
    visible: int
    lost: int
    new: int
    scene: float


def change(photo: Answer, variant: Answer) -> Change:
    """Compare the answer to a photo with that to its variant."""
    ours, theirs = (largest_first(one.people) for one in (photo, variant))
    cut = [person.mask & variant.inside for person in ours]
    found = match_by_masks(_stack([person.mask for person in theirs]), _stack(cut)).predicted_of
    counted = [
        i
        for i, person in enumerate(ours[:LARGEST])
        if cut[i].any() and cut[i].sum() >= LEAST_VISIBLE * person.mask.sum()
    ]
    stated = [one.distance_sigma or math.nan for one in (photo, variant)]
    sigma = math.hypot(*stated) / math.sqrt(2)
    both = np.isfinite(photo.depth) & np.isfinite(variant.depth)
    return Change(
        people=tuple(
            _person_change(i, ours[i], theirs[found[i]], sigma) for i in counted if i in found
        ),
        visible=len(counted),
        lost=len(set(counted) - set(found)),
        new=len(set(range(len(theirs[:LARGEST]))) - set(found.values())),
        scene=float(np.log(np.median(variant.depth[both] / photo.depth[both])))
        if both.any()
        else math.nan,
    )


def largest_first(people: Sequence[SeenPerson]) -> list[SeenPerson]:
    """Return people by the area of their masks."""
    return sorted(people, key=lambda person: -int(person.mask.sum()))


def same_people(one: Answer, other: Answer) -> dict[int, int]:
    """Return rank -> rank of the people of two answers to the same picture."""
    masks = [_stack([p.mask for p in largest_first(answer.people)]) for answer in (other, one)]
    return match_by_masks(*masks).predicted_of


def _person_change(rank: int, photo: SeenPerson, variant: SeenPerson, sigma: float) -> PersonChange:
    distance = math.log(variant.distance / photo.distance)
    before, after = (math.nan if one.trust is None else one.trust for one in (photo, variant))
    return PersonChange(
        person=rank,
        distance=distance,
        sigmas=distance / sigma,
        parts=tuple(
            (p, variant.parts[part]) for part, p in photo.parts.items() if part in variant.parts
        ),
        usable=(photo.usable, variant.usable),
        trust=after - before,
    )


def _stack(masks: Sequence[NDArray[np.bool_]]) -> NDArray[np.bool_]:
    return np.array(masks, bool).reshape(-1, GRID, GRID)


def table(changes: Mapping[str, Sequence[Change]]) -> list[list[str]]:
    """Return the header and one row for each variant: variant -> changes of photos.

    "distance %", say, is the median and the 90th percentile, "distance / sigma" also the 95th.
    """
    rows = [[name, *_row(found).values()] for name, found in changes.items()]
    return [["variant", *_row(())], *rows]


def _row(changes: Sequence[Change]) -> dict[str, str]:
    """Return column -> what it says of the changes of a variant."""
    people = [person for one in changes for person in one.people]
    lost = sum(one.lost + one.new for one in changes)
    parts = np.array([pair for person in people for pair in person.parts]).reshape(-1, 2)
    unsure = ((parts >= UNSURE[0]) & (parts <= UNSURE[1])).any(-1)
    crosses = (parts[:, 0] >= 0.5) != (parts[:, 1] >= 0.5)
    visible = sum(one.visible for one in changes)
    return {
        "people": str(len(people)),
        "lost or new %": _percent(lost, visible),
        "distance %": _spread((p.distance for p in people), _as_percent),
        "distance / sigma": _spread((p.sigmas for p in people), None, (50, 90, 95)),
        "scene %": _spread((one.scene for one in changes), _as_percent),
        "unsure parts cross %": _percent(int((crosses & unsure).sum()), int(unsure.sum())),
        "usable marks %": _percent(sum(len(set(p.usable)) > 1 for p in people), len(people)),
        "trust": _spread(p.trust for p in people),
    }


def _as_percent(logarithm: float) -> float:
    return 100 * math.expm1(logarithm)


def _percent(count: int, total: int) -> str:
    return f"{100 * count / total:.0f}" if total else "-"


def _spread(
    values: Iterable[float],
    unit: Callable[[float], float] | None = None,
    percentiles: Sequence[float] = (50, 90),
) -> str:
    """Return percentiles of the absolute values that are known."""
    known = [abs(value) for value in values if math.isfinite(value)]
    if not known:
        return "-"
    return "; ".join(f"{unit(v) if unit else v:.2g}" for v in np.percentile(known, percentiles))
