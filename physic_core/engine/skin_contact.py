"""Whom each part touches, and where: of parts that the observer says touch another person, or
another part of the own body, the nearest skin that may be it.

Depths of limbs are less sure than their places in the picture, so that a distance along the view
counts less than one across it. Skin of a part of which the observer gives the same answer is
likelier than that of others. Camera frame, metres.
"""

from __future__ import annotations

import math
from operator import attrgetter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor

from physic_core.engine.body_parts import OBSERVED, are_adjacent, contact_regions
from physic_core.engine.ground.touch import touch_rates
from physic_core.geometry.neighbors import array_tree
from physic_core.geometry.tensors import exact_arrays
from physic_core.types.observations import LEAST_PROBABILITY, TOUCHED

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray, Int64Array


_DEPTH_SHARE = 0.35  # of a distance along the view that counts
_REACH_M = 0.5  # largest such distance of parts that touch
_ANSWER_M = 0.05  # distance that outweighs one sigma of the answer of the other part
_UNSAID = 0.3  # probability of parts of which the observer says nothing
_LEAST_ANSWER = 1e-3  # that counts
_LEAST_ALONE = 0.1  # probability of a part that may touch skin, if that of the other is larger
_NEAREST = 5  # vertex whose distance is that of a part
_PATCH_M = 0.02  # vertices this much farther than the nearest touch, too


class SkinContact(NamedTuple):
    """A part of a person that touches a part of another person, or of the same body.

    Attributes:
        person: row of who touches.
        part: name.
        other: row of the other person; ``person`` for the own body.
        other_part: name.
        probability: that the part touches the other; by both answers where there are two.
        skin: (k,) int64, vertices of the part that touch.
        on_other: (k,) int64, vertex of the other part that is nearest to each.
        other_skin: (m,) int64, vertices of the other part that touch.
        on_own: (m,) int64, vertex of the part that is nearest to each.
    """

    person: int
    part: str
    other: int
    other_part: str
    probability: float
    skin: Tensor
    on_other: Tensor
    other_skin: Tensor
    on_own: Tensor


def find_skin_contacts(
    model: BodyModel, vertices: Tensor, touch: Tensor | None
) -> tuple[SkinContact, ...]:
    """Return the part that each part touches which probably touches skin, most probable last; none
    for people whose vertices are not finite, and where no other skin is in reach.

    Args:
        model: of the bodies.
        vertices: (N, V, 3) metres.
        touch: (N, 10, 5) as ``State.observed_touch``; None without an observer.
    """
    if touch is None:
        return ()
    names, region = contact_regions(model)
    (points, observed), (region_of_vertex, outer) = (
        exact_arrays(vertices, touch),
        exact_arrays(region, model.outer),
    )
    vertices_of_part = {
        name: np.flatnonzero((region_of_vertex == i) & outer) for i, name in enumerate(names)
    }
    everyone = np.flatnonzero(np.isfinite(points).all((1, 2))).tolist()
    contacts = []
    for i in everyone:
        for part, row in OBSERVED.items():
            for touched in ("person", "own body"):
                if not observed[i, row, TOUCHED.index(touched)] >= _LEAST_ALONE:
                    continue
                others = [i] if touched == "own body" else [j for j in everyone if j != i]
                contact = _nearest_contact(points, observed, vertices_of_part, (i, part), others)
                if contact is not None and contact[2] >= LEAST_PROBABILITY:
                    skin = (torch.from_numpy(ids).to(region) for ids in contact[3:])
                    contacts.append(SkinContact(i, part, *contact[:3], *skin))
    return tuple(sorted(contacts, key=lambda one: one.probability))


def touch_with_skin_contacts(touch: Tensor, contacts: Iterable[SkinContact]) -> Tensor:
    """Return what parts touch, (N, 10, 5) as ``State.observed_touch``, where a part that meets skin
    does so with the probability of the meeting, and its other answers share the rest.
    """
    touch = touch.clone()
    for contact in contacts:
        touched = TOUCHED.index("own body" if contact.other == contact.person else "person")
        for person, part in ((contact.person, contact.part), (contact.other, contact.other_part)):
            row = touch[person, OBSERVED[part]] if part in OBSERVED else touch.new_zeros(0)
            if len(row) and contact.probability > row[touched]:
                row *= (1 - contact.probability) / (1 - row[touched])
                row[touched] = contact.probability
    return touch


def _nearest_contact(
    points: FloatArray,
    observed: FloatArray,
    vertices_of_part: dict[str, Int64Array],
    touching_part: tuple[int, str],
    others: list[int],
) -> tuple[int, str, float, Int64Array, Int64Array, Int64Array, Int64Array] | None:
    """Return other person and part, probability, and the vertices that touch, of the part in reach
    that costs least; None without one.
    """
    i, part = touching_part
    depth = float(points[i, vertices_of_part[part], 2].mean())
    skin = _with_reduced_depth(points[i, vertices_of_part[part]], depth)
    cost = math.inf
    best = None
    candidates = _contact_candidates(
        points, observed, vertices_of_part, touching_part, others, skin, depth
    )
    for candidate in sorted(candidates, key=attrgetter("least_cost")):
        if candidate.least_cost >= cost:
            break
        gap, touching, nearest = _contact_patch(skin, candidate.target)
        if gap <= _REACH_M and gap**2 + candidate.pairs_cost < cost:
            cost = gap**2 + candidate.pairs_cost
            best = candidate, touching, nearest
    if best is None:
        return None
    candidate, touching, nearest = best
    _, other_touching, other_nearest = _contact_patch(candidate.target, skin)
    part_vertices, other_vertices = vertices_of_part[part], vertices_of_part[candidate.part]
    touch = (
        part_vertices[touching],
        other_vertices[nearest],
        other_vertices[other_touching],
        part_vertices[other_nearest],
    )
    return candidate.person, candidate.part, candidate.probability, *touch


class _ContactCandidate(NamedTuple):
    """A part that another may touch: the least cost of the touch, what its own answer costs, whose
    part it is, the probability of the touch, and its vertices as :func:`_with_reduced_depth`.
    """

    least_cost: float
    pairs_cost: float
    person: int
    part: str
    probability: float
    target: FloatArray


def _contact_candidates(
    points: FloatArray,
    observed: FloatArray,
    vertices_of_part: dict[str, Int64Array],
    touching_part: tuple[int, str],
    others: list[int],
    skin: FloatArray,
    depth: float,
) -> Iterator[_ContactCandidate]:
    """Yield the parts of others that the skin (n, 3) of a person's part can reach."""
    i, part = touching_part
    for j in others:
        touched = TOUCHED.index("own body" if j == i else "person")
        alone = float(observed[i, OBSERVED[part], touched])
        for other, ids in vertices_of_part.items():
            if j == i and (other == part or are_adjacent(part, other)):
                continue
            target = _with_reduced_depth(points[j, ids], depth)
            box_gap = np.maximum(skin.min(0) - target.max(0), target.min(0) - skin.max(0))
            # no vertex is nearer than the boxes of both parts
            least_cost = float(np.square(box_gap.clip(0)).sum())
            if least_cost > _REACH_M**2:
                continue
            probability, other_answer = alone, _UNSAID
            if other in OBSERVED and not math.isnan(observed[j, OBSERVED[other], touched]):
                other_answer = float(observed[j, OBSERVED[other], touched])
                rates = touch_rates()[[OBSERVED[part], OBSERVED[other]], touched]
                probability = _mutual_probability(alone, other_answer, float(rates.max()))
            pairs_cost = -2 * _ANSWER_M**2 * math.log(max(other_answer, _LEAST_ANSWER))
            yield _ContactCandidate(
                least_cost + pairs_cost, pairs_cost, j, other, probability, target
            )


def _mutual_probability(first: float, second: float, rate: float) -> float:
    """Return the probability that two parts touch each other, by that of each that it touches, and
    the rate of such parts: that one does is that the other does.
    """
    odds = [p / (1 - p) for p in np.clip([first, second], _LEAST_ANSWER, 1 - _LEAST_ANSWER)]
    both = odds[0] * odds[1] / (rate / (1 - rate))
    return float(both / (1 + both))


def _contact_patch(skin: FloatArray, target: FloatArray) -> tuple[float, Int64Array, Int64Array]:
    """Return the distance of skin (n, 3) from a target (m, 3), the vertices (k,) of the skin that
    are hardly farther, and the nearest of the target to each.
    """
    gap, nearest = array_tree(target).query(skin)
    order = np.argsort(gap, kind="stable")
    part_gap = float(gap[order[min(_NEAREST, len(order)) - 1]])
    touching = order[gap[order] <= part_gap + _PATCH_M]
    return part_gap, touching, nearest[touching]


def _with_reduced_depth(points: FloatArray, depth: float) -> FloatArray:
    """Return points (n, 3) with sides in metres at a depth, and less of their own depth."""
    z = np.maximum(points[:, 2:], 1e-3)
    return np.concatenate([points[:, :2] / z * depth, _DEPTH_SHARE * points[:, 2:]], 1)
