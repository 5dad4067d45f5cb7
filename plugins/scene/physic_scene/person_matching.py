"""Match the people of several photos by the energy of the cameras that each answer gives.

The user says that the photos are of one moment, so that two of them always have a best answer.
Pose, stature and clothes of a pair of people order the first guesses. Each guess gives a motion
between the cameras, and the motion brings further people into the same place. The bundle adjustment
of these people decides between the answers: half of its energy, plus the cost of different clothes,
minus a bonus for each matched person.

Over more photos, each pair of people has odds: the best answer of their two photos in which they
are the same person against the best one in which they are not. The surest pairs are joined first,
as long as the photos of both sides agree.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linear_sum_assignment

from physic_scene.bundle import SOLVED_CAMERAS, Bundle, MomentObservations, adjust, energy
from physic_scene.rigid import CameraPose, fit_rotation, rotation_angle_deg

if TYPE_CHECKING:
    from physic_core.types import FloatArray, IntArray
    from physic_scene.observations import PhotoPeople

_BODY = 22  # joints without hands and face
_PELVIS = 0
_UNLIKE = 1e3  # of a pair that no answer may have
_SAME_PLACE = 9.0  # largest sum of squares of pose, place and turn, in their units, of one person

# All below were chosen on three moments of a rig of five cameras.
_WORTH = 40.0
"""Half of the energy that one more matched person may cost.

Of 30 pairs of photos, the second and third person of right answers cost 10 to 40. 25 and 40 join as
many pairs by the right people, with 33 and with 55 right and 4 and 4 wrong people.
"""
_CLOTHES = 3.0
"""Cost of a difference of the chroma of clothes, per CIELAB unit.

With 3, 26 of 30 pairs of photos have the right people; without, 21.
"""
_CLOTHES_MOST = 36.0
"""Largest cost of the clothes of one person: that of 12 units, which light of two colours makes."""
_POSE_M = 0.15
_PLACE = 0.15
_TURN_DEG = 25.0
"""Differences that count as one unit in the order of the guesses: mean of 22 joints, of places as a
share of the distance, and of turns.
"""
_GUESSES = 8  # pairs of people of two photos that give a motion, the likeliest first
# Each answer starts near the solution.
_QUICK = replace(SOLVED_CAMERAS, rounds=SOLVED_CAMERAS.rounds[1:], steps=10)

Pairs = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class PairMatch:
    """Best answer for the people of two photos.

    Attributes:
        pairs: (person of the first, person of the second) of each matched pair.
        score: of the answer, a logarithm of a likelihood up to a constant of the two photos.
        motion: from the frame of the first camera to that of the second.
        odds: (N, M) logarithm of the odds that two people are the same person.
    """

    pairs: Pairs
    score: float
    motion: CameraPose
    odds: FloatArray


def match_pair(one: PhotoPeople, two: PhotoPeople) -> PairMatch:
    """Match the people of two photos."""
    pose, turns = compare_poses(one, two)
    clothes = _clothing_cost(one, two)
    costs: dict[Pairs, tuple[float, CameraPose]] = {}
    for pairs in dict.fromkeys(_candidate_answers(one, two, pose, turns, clothes)):
        cost, motion = pairs_cost(one, two, pairs, relative_motion(one, two, pairs))
        costs[pairs] = _WORTH * len(pairs) - cost, motion
    best = max(costs, key=lambda pairs: costs[pairs][0])
    return PairMatch(
        best, *costs[best], _pair_odds({p: score for p, (score, _) in costs.items()}, pose.shape)
    )


def pairs_cost(
    one: PhotoPeople, two: PhotoPeople, pairs: Pairs, motion: CameraPose
) -> tuple[float, CameraPose]:
    """Return what an answer costs, half of the energy of its people and their clothes, and its
    motion near a start.
    """
    observations = MomentObservations.of([one, two], np.array(pairs))
    state = adjust(
        observations, Bundle.start(observations, [CameraPose.identity(), motion]), 0, _QUICK
    )
    clothes = _clothing_cost(one, two)
    return energy(observations, state, 0, _QUICK) / 2 + float(
        sum(clothes[pair] for pair in pairs)
    ), state.pose(1)


def _clothing_cost(one: PhotoPeople, two: PhotoPeople) -> FloatArray:
    """Return the cost (N, M) of the mean difference of the chroma of clothes, CIELAB; 0 where no
    part is seen in both photos.
    """
    a, b = (people.colours[..., 1:] for people in (one, two))
    away = np.linalg.norm(a[:, None] - b[None], axis=-1)
    compared = np.isfinite(away)
    mean = np.where(compared, away, 0).sum(-1) / np.maximum(compared.sum(-1), 1)
    cost: FloatArray = np.minimum(_CLOTHES * mean, _CLOTHES_MOST)
    return cost


def _pair_odds(scores: Mapping[Pairs, float], shape: tuple[int, ...]) -> FloatArray:
    """Return the best score with each pair of people, less the best one without; of the worst
    answer for no answer.
    """
    odds = np.zeros(shape)
    worst = min(scores.values())
    for pair in np.ndindex(*shape):
        having, other = (
            [s for pairs, s in scores.items() if (pair in pairs) is own] for own in (True, False)
        )
        odds[pair] = max(having, default=worst) - max(other, default=worst)
    return odds


def _candidate_answers(
    one: PhotoPeople, two: PhotoPeople, pose: FloatArray, turns: FloatArray, clothes: FloatArray
) -> Iterator[Pairs]:
    """Yield answers: each guess by itself, and with the people whom its motion brings together."""
    stature = np.abs(np.log(one.stature[:, None] / two.stature))
    unlike = pose / _POSE_M + stature / _PLACE + clothes / _CLOTHES_MOST
    for guess in np.argsort(unlike, axis=None, kind="stable")[:_GUESSES]:
        i, j = (int(k) for k in np.unravel_index(guess, unlike.shape))
        pairs: Pairs = ((i, j),)
        yield pairs
        for _ in range(2):
            motion = relative_motion(one, two, pairs)
            place_cost = compare_places(one, two, motion)
            turn = rotation_angle_deg(turns, motion.rotation)
            apart = (place_cost / _PLACE) ** 2 + (turn / _TURN_DEG) ** 2 + (pose / _POSE_M) ** 2
            apart[i] = _UNLIKE
            apart[:, j] = _UNLIKE
            apart[i, j] = 0
            chosen = zip(*linear_sum_assignment(np.minimum(apart, _SAME_PLACE)), strict=True)
            pairs = tuple((int(a), int(b)) for a, b in chosen if apart[a, b] < _SAME_PLACE)
        yield pairs


def _next_pair(
    groups: Sequence[Mapping[int, int]],
    linked: Sequence[set[int]],
    matches: Mapping[tuple[int, int], PairMatch],
) -> tuple[int, int] | None:
    """Return the groups to join next; None if no more are one person and all photos are linked."""

    def summed_odds(one: Mapping[int, int], two: Mapping[int, int]) -> float:
        pairs = (sorted(pair) for pair in itertools.product(one.items(), two.items()))
        return float(sum(matches[a, b].odds[i, j] for (a, i), (b, j) in pairs))

    gain = {
        (g, h): summed_odds(groups[g], groups[h])
        for g, h in itertools.combinations(range(len(groups)), 2)
        if not groups[g].keys() & groups[h].keys()
    }
    chosen = [pair for pair, value in gain.items() if value > 0] or [
        (g, h) for g, h in gain if not any({*groups[g], *groups[h]} <= s for s in linked)
    ]
    return max(chosen, key=lambda pair: gain[pair], default=None)


def join_tracks(
    people: Sequence[PhotoPeople], matches: Mapping[tuple[int, int], PairMatch]
) -> IntArray:
    """Join matches of pairs of photos to people over all photos; no photo shows a person twice.

    Two groups of views of a person are joined if the summed log odds of all their pairs are
    positive, the largest first. Photos without a common person are then joined by their likeliest
    pair, since they are of one moment.

    Args:
        people: of each photo.
        matches: of each pair of photos a < b.

    Returns:
        Row (P, V) of each person in each photo, -1 where the photo does not show the person.
    """
    groups = [{v: i} for v, photo in enumerate(people) for i in range(len(photo))]
    linked = [{v} for v in range(len(people))]
    while pair := _next_pair(groups, linked, matches):
        g, h = pair
        groups[g] |= groups.pop(h)
        own_photos = [photos for photos in linked if photos & groups[g].keys()]
        linked = [photos for photos in linked if photos not in own_photos] + [
            set().union(*own_photos)
        ]
    tracks = sorted((m for m in groups if len(m) > 1), key=lambda m: (-len(m), min(m.items())))
    rows = np.full((len(tracks), len(people)), -1)
    for t, members in enumerate(tracks):
        for v, i in members.items():
            rows[t, v] = i
    return rows


def joined_matches(
    people: Sequence[PhotoPeople], matches: Mapping[tuple[int, int], PairMatch], rows: IntArray
) -> dict[tuple[int, int], PairMatch]:
    """Return the matches of pairs of photos that follow from the people (P, V) over all photos."""
    joined = {}
    for (a, b), match in matches.items():
        both = rows[(rows[:, [a, b]] >= 0).all(1)]
        pairs = tuple((int(row[a]), int(row[b])) for row in both)
        same = sorted(pairs) == sorted(match.pairs)
        motion = match.motion if same or not pairs else relative_motion(people[a], people[b], pairs)
        joined[a, b] = replace(match, pairs=pairs, motion=motion)
    return joined


def compare_poses(one: PhotoPeople, two: PhotoPeople) -> tuple[FloatArray, FloatArray]:
    """Compare the poses of the people of two photos.

    Returns:
        The mean distance (N, M) of 22 joints after the best rotation about the pelvis, metres, and
        these rotations (N, M, 3, 3) from the first camera to the second.
    """
    away = np.zeros((len(one), len(two)))
    turns = np.zeros((len(one), len(two), 3, 3))
    for i, j in np.ndindex(away.shape):
        a, b = (p.joints[k, :_BODY] - p.joints[k, _PELVIS] for p, k in ((one, i), (two, j)))
        turns[i, j] = fit_rotation(a, b, np.ones(_BODY))
        scale = np.linalg.norm(b) / np.linalg.norm(a)
        away[i, j] = np.linalg.norm(scale * a @ turns[i, j].T - b, axis=1).mean()
    return away, turns


def compare_places(one: PhotoPeople, two: PhotoPeople, motion: CameraPose) -> FloatArray:
    """Return the distance (N, M) of the pelvis from where the other photo has it under a motion
    between the cameras, as a share of the mean distance from both.
    """
    there = motion.to_camera(one.joints[:, _PELVIS])
    apart = np.linalg.norm(there[:, None] - two.joints[None, :, _PELVIS], axis=-1)
    reach = (one.joints[:, _PELVIS, 2][:, None] + two.joints[:, _PELVIS, 2][None]) / 2
    share: FloatArray = apart / reach
    return share


def relative_motion(one: PhotoPeople, two: PhotoPeople, pairs: Pairs) -> CameraPose:
    """Return the known motion between the cameras, or the one that fits matched people: their poses
    and places.
    """
    if one.pose is not None and two.pose is not None:
        return two.pose.after(one.pose.inverse())
    i, j = (np.array([pair[k] for pair in pairs], np.int64) for k in (0, 1))
    a = one.joints[i, :_BODY]
    b = two.joints[j, :_BODY]
    inner = [x - x[:, :1] for x in (a, b)]
    outer = [x[:, 0] - x[:, 0].mean(axis=0) for x in (a, b)]
    source, target = (
        np.concatenate([x.reshape(-1, 3), y]) for x, y in zip(inner, outer, strict=True)
    )
    # Places have the error of depth, poses that of limbs.
    weight = np.concatenate([np.ones(inner[0].size // 3), np.full(len(pairs), 2.0)])
    rotation = fit_rotation(source, target, weight)
    return CameraPose(
        rotation, np.median(two.joints[j, _PELVIS] - one.joints[i, _PELVIS] @ rotation.T, axis=0)
    )
