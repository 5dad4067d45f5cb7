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
from physic_core.engine.ground.touch import usual_touch
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


class Meeting(NamedTuple):
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


def meetings(model: BodyModel, vertices: Tensor, touch: Tensor | None) -> tuple[Meeting, ...]:
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
    (points, said), (of, outer) = exact_arrays(vertices, touch), exact_arrays(region, model.outer)
    parts = {name: np.flatnonzero((of == i) & outer) for i, name in enumerate(names)}
    everyone = np.flatnonzero(np.isfinite(points).all((1, 2))).tolist()
    pairs = []
    for i in everyone:
        for part, row in OBSERVED.items():
            for word in ("person", "own body"):
                if not said[i, row, TOUCHED.index(word)] >= _LEAST_ALONE:
                    continue
                others = [i] if word == "own body" else [j for j in everyone if j != i]
                met = _likeliest_touch(points, said, parts, (i, part), others)
                if met is not None and met[2] >= LEAST_PROBABILITY:
                    skin = (torch.from_numpy(ids).to(region) for ids in met[3:])
                    pairs.append(Meeting(i, part, *met[:3], *skin))
    return tuple(sorted(pairs, key=lambda one: one.probability))


def touch_by_meetings(touch: Tensor, pairs: Iterable[Meeting]) -> Tensor:
    """Return what parts touch, (N, 10, 5) as ``State.observed_touch``, where a part that meets skin
    does so with the probability of the meeting, and its other answers share the rest.
    """
    touch = touch.clone()
    for one in pairs:
        word = TOUCHED.index("own body" if one.other == one.person else "person")
        for person, part in ((one.person, one.part), (one.other, one.other_part)):
            row = touch[person, OBSERVED[part]] if part in OBSERVED else touch.new_zeros(0)
            if len(row) and one.probability > row[word]:
                row *= (1 - one.probability) / (1 - row[word])
                row[word] = one.probability
    return touch


def _likeliest_touch(
    points: FloatArray,
    said: FloatArray,
    parts: dict[str, Int64Array],
    own: tuple[int, str],
    others: list[int],
) -> tuple[int, str, float, Int64Array, Int64Array, Int64Array, Int64Array] | None:
    """Return other person and part, probability, and the vertices that touch, of the part in reach
    that costs least; None without one.
    """
    i, part = own
    depth = float(points[i, parts[part], 2].mean())
    skin = _by_view(points[i, parts[part]], depth)
    cost = math.inf
    met = None
    reach = _parts_in_reach(points, said, parts, own, others, skin, depth)
    for one in sorted(reach, key=attrgetter("bound")):
        if one.bound >= cost:
            break
        size, touching, nearest = _patch(skin, one.target)
        if size <= _REACH_M and size**2 + one.unlikely < cost:
            cost = size**2 + one.unlikely
            met = one, touching, nearest
    if met is None:
        return None
    one, touching, nearest = met
    _, other_touching, other_nearest = _patch(one.target, skin)
    mine, theirs = parts[part], parts[one.part]
    touch = mine[touching], theirs[nearest], theirs[other_touching], mine[other_nearest]
    return one.person, one.part, one.probability, *touch


class _PartInReach(NamedTuple):
    """A part that another may touch: the least cost of the touch, what its own answer costs, whose
    part it is, the probability of the touch, and its vertices as :func:`_by_view`.
    """

    bound: float
    unlikely: float
    person: int
    part: str
    probability: float
    target: FloatArray


def _parts_in_reach(
    points: FloatArray,
    said: FloatArray,
    parts: dict[str, Int64Array],
    own: tuple[int, str],
    others: list[int],
    skin: FloatArray,
    depth: float,
) -> Iterator[_PartInReach]:
    """Yield the parts of others that the skin (n, 3) of a person's part can reach."""
    i, part = own
    for j in others:
        word = TOUCHED.index("own body" if j == i else "person")
        alone = float(said[i, OBSERVED[part], word])
        for other, ids in parts.items():
            if j == i and (other == part or are_adjacent(part, other)):
                continue
            target = _by_view(points[j, ids], depth)
            apart = np.maximum(skin.min(0) - target.max(0), target.min(0) - skin.max(0))
            # no vertex is nearer than the boxes of both parts
            least = float(np.square(apart.clip(0)).sum())
            if least > _REACH_M**2:
                continue
            likely, answer = alone, _UNSAID
            if other in OBSERVED and not math.isnan(said[j, OBSERVED[other], word]):
                answer = float(said[j, OBSERVED[other], word])
                rates = usual_touch()[[OBSERVED[part], OBSERVED[other]], word]
                likely = _of_both(alone, answer, float(rates.max()))
            unlikely = -2 * _ANSWER_M**2 * math.log(max(answer, _LEAST_ANSWER))
            yield _PartInReach(least + unlikely, unlikely, j, other, likely, target)


def _of_both(one: float, other: float, rate: float) -> float:
    """Return the probability that two parts touch each other, by that of each that it touches, and
    the rate of such parts: that one does is that the other does.
    """
    odds = [p / (1 - p) for p in np.clip([one, other], _LEAST_ANSWER, 1 - _LEAST_ANSWER)]
    both = odds[0] * odds[1] / (rate / (1 - rate))
    return float(both / (1 + both))


def _patch(skin: FloatArray, target: FloatArray) -> tuple[float, Int64Array, Int64Array]:
    """Return the distance of skin (n, 3) from a target (m, 3), the vertices (k,) of the skin that
    are hardly farther, and the nearest of the target to each.
    """
    gap, nearest = array_tree(target).query(skin)
    order = np.argsort(gap, kind="stable")
    size = float(gap[order[min(_NEAREST, len(order)) - 1]])
    touching = order[gap[order] <= size + _PATCH_M]
    return size, touching, nearest[touching]


def _by_view(points: FloatArray, depth: float) -> FloatArray:
    """Return points (n, 3) with sides in metres at a depth, and less of their own depth."""
    z = np.maximum(points[:, 2:], 1e-3)
    return np.concatenate([points[:, :2] / z * depth, _DEPTH_SHARE * points[:, 2:]], 1)
