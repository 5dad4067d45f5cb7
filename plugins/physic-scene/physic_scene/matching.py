"""Who is who: people of several photos matched by shape, pose, the colours of clothes, and geometry.

For each pair of photos, each pair of people gives a hypothesis of the relative camera. The assignment of all people
under the best hypothesis is that of the pair of photos. Tracks over all photos then join these pairs, the surest first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linear_sum_assignment

from physic_scene.rigid import Pose, angle_deg, fit_rotation

if TYPE_CHECKING:
    from physic_core.types import FloatArray, IntArray
    from physic_scene.observations import PhotoPeople

__all__ = ["MatchingSettings", "PairMatch", "Tracks", "join_tracks", "match_pair"]

_BODY = 22  # joints without hands and face
_PELVIS = 0


@dataclass(frozen=True)
class MatchingSettings:
    """Expected differences between two photos of one person; costs are squares in units of these.

    Attributes:
        pose_m: mean distance of 22 joints after the best rotation about the pelvis.
        stature: of the logarithm of stature.
        colour: CIELAB distance of the mean colour of a body part.
        turn_deg: between the camera's rotation from one person and from another.
        place: distance of a person from the place that the other photo gives, as a share of the distance from the
            cameras.
        unmatched: largest cost of two people who are matched; the sum of the squares above.
    """

    pose_m: float = 0.07
    stature: float = 0.06
    colour: float = 14.0
    turn_deg: float = 20.0
    place: float = 0.12
    unmatched: float = 12.0


@dataclass(frozen=True)
class PairMatch:
    """People of two photos who are the same.

    Attributes:
        pairs: (person of the first, person of the second, cost) of each matched pair.
        score: sum over the pairs of ``unmatched`` minus their cost; 0 without a match.
        motion: from the frame of the first camera to that of the second, up to the errors of depth.
    """

    pairs: tuple[tuple[int, int, float], ...]
    score: float
    motion: Pose


@dataclass(frozen=True)
class Tracks:
    """People of the moment.

    Attributes:
        rows: (P, V) row of each person in each photo, -1 where the photo does not show the person.
    """

    rows: IntArray


def match_pair(one: PhotoPeople, two: PhotoPeople, settings: MatchingSettings) -> PairMatch:
    """Match the people of two photos."""
    best = PairMatch((), 0.0, Pose.identity())
    if not len(one) or not len(two):
        return best
    looks, turns = _look_costs(one, two, settings)
    order = np.argsort(looks, axis=None)
    for i, j in zip(*np.unravel_index(order, looks.shape), strict=True):
        if looks[i, j] > settings.unmatched:
            break
        rotation, pairs = turns[i, j], [(int(i), int(j), 0.0)]
        motion = _motion(one, two, rotation, pairs)
        for _ in range(2):
            cost = looks + _place_costs(one, two, motion, turns, settings)
            pairs = _assign(cost, settings.unmatched)
            if not pairs:
                break
            motion = _refined_motion(one, two, pairs)
        score = sum(settings.unmatched - cost for *_, cost in pairs)
        if score > best.score:
            best = PairMatch(tuple(pairs), float(score), motion)
    return best


def join_tracks(people: Sequence[PhotoPeople], matches: dict[tuple[int, int], PairMatch]) -> Tracks:
    """Join matches of pairs of photos to people over all photos; no photo shows a person twice.

    Args:
        people: of each photo.
        matches: of each pair of photos a < b.
    """
    links = []
    for (a, b), match in matches.items():
        # A pair of photos that agrees on many people is surer of each of them.
        links += [(match.score - 3 * cost, a, i, b, j) for i, j, cost in match.pairs]
    group = {(v, i): {(v, i)} for v, photo in enumerate(people) for i in range(len(photo))}
    for _, a, i, b, j in sorted(links, reverse=True):
        one, two = group[a, i], group[b, j]
        if one is two or {v for v, _ in one} & {v for v, _ in two}:
            continue
        one |= two
        for member in two:
            group[member] = one
    distinct = {id(members): members for members in group.values()}.values()
    tracks = sorted((members for members in distinct if len(members) > 1), key=lambda m: (-len(m), min(m)))
    rows = np.full((len(tracks), len(people)), -1)
    for t, members in enumerate(tracks):
        for v, i in members:
            rows[t, v] = i
    return Tracks(rows)


def _look_costs(one: PhotoPeople, two: PhotoPeople, settings: MatchingSettings) -> tuple[FloatArray, FloatArray]:
    """Return costs (N, M) of pose, stature and colours, and the rotations (N, M, 3, 3) between the cameras."""
    costs, turns = np.zeros((len(one), len(two))), np.zeros((len(one), len(two), 3, 3))
    weight = np.ones(_BODY)
    for i in range(len(one)):
        for j in range(len(two)):
            a, b = (p.joints[k, :_BODY] - p.joints[k, _PELVIS] for p, k in ((one, i), (two, j)))
            scale = np.linalg.norm(b) / np.linalg.norm(a)
            turns[i, j] = fit_rotation(a, b, weight)
            pose = np.linalg.norm(scale * a @ turns[i, j].T - b, axis=1).mean() / settings.pose_m
            size = np.log(one.stature[i] / two.stature[j]) / settings.stature
            colour = np.linalg.norm(one.colours[i] - two.colours[j], axis=1) / settings.colour
            seen = colour[np.isfinite(colour)]
            costs[i, j] = pose**2 + size**2 + (2 * np.mean(np.minimum(seen, 4) ** 2) if len(seen) else 1.0)
    return costs, turns


def _motion(one: PhotoPeople, two: PhotoPeople, rotation: FloatArray, pairs: list[tuple[int, int, float]]) -> Pose:
    """Return the motion with a known rotation that takes the pelvis of matched people to where the other photo is."""
    i, j = _columns(pairs)
    moved = two.joints[j, _PELVIS] - one.joints[i, _PELVIS] @ rotation.T
    return Pose(rotation, np.median(moved, axis=0))


def _refined_motion(one: PhotoPeople, two: PhotoPeople, pairs: list[tuple[int, int, float]]) -> Pose:
    """Return the motion that fits all joints of matched people: turns by their poses, and by their places."""
    i, j = _columns(pairs)
    a, b = one.joints[i, :_BODY], two.joints[j, :_BODY]
    inner = [x - x[:, :1] for x in (a, b)]
    outer = [(x[:, 0] - x[:, 0].mean(axis=0)) for x in (a, b)]
    source, target = (np.concatenate([x.reshape(-1, 3), y]) for x, y in zip(inner, outer, strict=True))
    # Places have the error of depth, poses that of limbs.
    weight = np.concatenate([np.ones(inner[0].size // 3), np.full(len(pairs), 2.0)])
    return _motion(one, two, fit_rotation(source, target, weight), pairs)


def _columns(pairs: list[tuple[int, int, float]]) -> tuple[IntArray, IntArray]:
    """Return the people of the first and of the second photo."""
    return np.array([i for i, *_ in pairs], np.int64), np.array([j for _, j, _ in pairs], np.int64)


def _place_costs(
    one: PhotoPeople, two: PhotoPeople, motion: Pose, turns: FloatArray, settings: MatchingSettings
) -> FloatArray:
    """Return costs (N, M) of the places and directions of people under a motion between the cameras."""
    there = motion.to_camera(one.joints[:, _PELVIS])
    apart = np.linalg.norm(there[:, None] - two.joints[None, :, _PELVIS], axis=-1)
    reach = (one.joints[:, _PELVIS, 2][:, None] + two.joints[:, _PELVIS, 2][None]) / 2
    turn = angle_deg(turns, motion.rotation)
    cost: FloatArray = (apart / (settings.place * reach)) ** 2 + (turn / settings.turn_deg) ** 2
    return cost


def _assign(cost: FloatArray, unmatched: float) -> list[tuple[int, int, float]]:
    """Return the assignment with the best sum of ``unmatched`` minus cost; pairs of a higher cost stay apart."""
    rows, columns = linear_sum_assignment(np.minimum(cost, unmatched))
    return [(int(i), int(j), float(cost[i, j])) for i, j in zip(rows, columns, strict=True) if cost[i, j] < unmatched]
