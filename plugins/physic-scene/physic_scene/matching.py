"""Who is who: people of several photos matched by shape, pose, the colours of clothes, and geometry.

Each cue gives the logarithm of a likelihood ratio (LLR), "the same person" over "different people", from the table that
was measured for it; their sum decides. For each pair of photos, each pair of people gives a hypothesis of the relative
camera. The assignment of all people under the best hypothesis is that of the pair of photos; matched pixels of the
background add the LLR of the camera. People over all photos then follow by joining the surest pairs first, as long as
the photos of both sides agree.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linear_sum_assignment

from physic_scene.measured import measured_errors
from physic_scene.rigid import Pose, angle_deg, fit_rotation

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, IntArray
    from physic_scene.background import BackgroundTurn
    from physic_scene.observations import PhotoPeople

_BODY = 22  # joints without hands and face
_PELVIS = 0
_GARMENTS = {"top": [0, 2], "legs": [3, 4]}
"""Cue of matching -> rows of COLOUR_GROUPS."""


@dataclass(frozen=True)
class MatchingSettings:
    """Prior odds of the matching; how much each cue says is measured (``measured_errors.json``).

    Attributes:
        stranger: logarithm of the odds that two people are different, before anything was compared and besides the
            number of people. Between 0 and 3 no match of people of eight worlds changes; of strange photos among four,
            23 % match at 0 and 5 % at 3.
        ambiguous: logarithm of the least odds of the best assignment of two photos over the best that contradicts it;
            with lower odds who is who stays open. 3 are odds of 20 to 1, the error of one in twenty. Of 228 right pairs
            of photos of 40 worlds, all have more.
        hypotheses: most pairs of people of two photos that give a relative camera, the likest first.
    """

    stranger: float = 3.0
    ambiguous: float = 3.0
    hypotheses: int = 16

    def accept(self, one: int, two: int) -> float:
        """Return the least LLR of two people of photos with this many people that makes them the same person."""
        return float(np.log(max(one, two, 1))) + self.stranger


@dataclass(frozen=True)
class PairMatch:
    """People of two photos who are the same.

    Attributes:
        pairs: (person of the first, person of the second, LLR) of each matched pair.
        score: sum over the pairs of their LLR over that of acceptance, and what the background adds; 0 without a match.
        motion: from the frame of the first camera to that of the second, up to the errors of depth.
        llr: (N, M) of all pairs of people, under this motion if any pair matches.
        background: rotation between the cameras by the background, None with too few matched pixels.
        margin: score less that of the best assignment that contradicts the pairs; infinite if there is none.
    """

    pairs: tuple[tuple[int, int, float], ...]
    score: float
    motion: Pose
    llr: FloatArray
    background: BackgroundTurn | None = None
    margin: float = np.inf


@dataclass(frozen=True)
class Tracks:
    """People of the moment.

    Attributes:
        rows: (P, V) row of each person in each photo, -1 where the photo does not show the person.
    """

    rows: IntArray


def match_pair(
    one: PhotoPeople, two: PhotoPeople, settings: MatchingSettings, background: BackgroundTurn | None = None
) -> PairMatch:
    """Match the people of two photos, whose backgrounds may give a rotation between the cameras."""
    cues, turns = look_cues(one, two)
    looks = _llr(cues, np.zeros((len(one), len(two))))
    found = [PairMatch((), 0.0, Pose.identity(), looks, background)]
    accept = settings.accept(len(one), len(two))
    order = np.argsort(-looks, axis=None, kind="stable")[: settings.hypotheses]
    for i, j in zip(*np.unravel_index(order, looks.shape), strict=True):
        pairs = [(int(i), int(j), float(looks[i, j]))]
        for _ in range(3):
            motion = relative_motion(one, two, pairs)
            llr = looks + _place_llr(one, two, motion, turns, pairs)
            pairs = _assign(llr, accept)
            if not pairs:
                break
        found.append(PairMatch(tuple(pairs), _score(pairs, accept, motion, background), motion, llr, background))
    best = max(found, key=lambda match: match.score)
    others = [match.score for match in found if _contradict(best, match)]
    return replace(best, margin=best.score - max(others, default=-np.inf))


def join_tracks(
    people: Sequence[PhotoPeople], matches: dict[tuple[int, int], PairMatch], settings: MatchingSettings
) -> Tracks:
    """Join matches of pairs of photos to people over all photos; no photo shows a person twice.

    Two groups of views of a person are joined if the LLRs of all their pairs together say so.

    Args:
        people: of each photo.
        matches: of each pair of photos a < b.
        settings: of the matching.
    """
    groups = [{v: i} for v, photo in enumerate(people) for i in range(len(photo))]
    accept = settings.accept(max(map(len, people)), 1)

    def together(one: dict[int, int], two: dict[int, int]) -> float:
        if one.keys() & two.keys():
            return -np.inf
        pairs = [((a, i), (b, j)) if a < b else ((b, j), (a, i)) for a, i in one.items() for b, j in two.items()]
        return float(sum(matches[a, b].llr[i, j] for (a, i), (b, j) in pairs))

    gain = {(g, h): together(groups[g], groups[h]) for g, h in itertools.combinations(range(len(groups)), 2)}
    while gain:
        (g, h), most = max(gain.items(), key=lambda item: item[1])
        if most <= accept:
            break
        groups[g] = groups[g] | groups[h]
        gain = {pair: value for pair, value in gain.items() if h not in pair and g not in pair}
        alive = {k for pair in gain for k in pair} | {k for k in range(len(groups)) if k not in (g, h) and groups[k]}
        groups[h] = {}
        gain |= {(min(g, k), max(g, k)): together(groups[g], groups[k]) for k in alive if groups[k]}
    tracks = sorted((m for m in groups if len(m) > 1), key=lambda m: (-len(m), min(m.items())))
    rows = np.full((len(tracks), len(people)), -1)
    for t, members in enumerate(tracks):
        for v, i in members.items():
            rows[t, v] = i
    return Tracks(rows)


def joined_matches(
    people: Sequence[PhotoPeople],
    matches: dict[tuple[int, int], PairMatch],
    rows: IntArray,
    settings: MatchingSettings,
) -> dict[tuple[int, int], PairMatch]:
    """Return the matches of pairs of photos that follow from the people (P, V) over all photos."""
    found = {}
    for (a, b), match in matches.items():
        both = rows[(rows[:, [a, b]] >= 0).all(1)]
        pairs = tuple((int(row[a]), int(row[b]), float(match.llr[row[a], row[b]])) for row in both)
        accept = settings.accept(len(people[a]), len(people[b]))
        motion = relative_motion(people[a], people[b], pairs) if pairs else match.motion
        score = max(_score(pairs, accept, motion, match.background), 0.0)
        found[a, b] = replace(match, pairs=pairs, score=score, motion=motion)
    return found


def look_cues(one: PhotoPeople, two: PhotoPeople) -> tuple[dict[str, FloatArray], FloatArray]:
    """Compare the people of two photos without their places.

    Returns:
        The cues (N, M), and the rotations (N, M, 3, 3) between the cameras that each pair gives. The cues are "pose",
        the mean distance of 22 joints after the best rotation about the pelvis, metres; "stature", the logarithm of the
        ratio; "top" and "legs", mean CIELAB distances of the chroma of these body parts; "lightness", that of the
        lightness of all parts. A cue is NaN where no such part is seen in both photos.
    """
    shape = (len(one), len(two))
    cues = {name: np.full(shape, np.nan) for name in ("pose", "stature", *_GARMENTS, "lightness")}
    turns, weight = np.zeros((*shape, 3, 3)), np.ones(_BODY)
    for i, j in np.ndindex(shape):
        a, b = (p.joints[k, :_BODY] - p.joints[k, _PELVIS] for p, k in ((one, i), (two, j)))
        turns[i, j] = fit_rotation(a, b, weight)
        scale = np.linalg.norm(b) / np.linalg.norm(a)
        cues["pose"][i, j] = np.linalg.norm(scale * a @ turns[i, j].T - b, axis=1).mean()
        cues["stature"][i, j] = abs(np.log(one.stature[i] / two.stature[j]))
        away = one.colours[i] - two.colours[j]
        seen: BoolArray = np.isfinite(away[:, 0])
        for name, groups in _GARMENTS.items():
            if seen[groups].any():
                cues[name][i, j] = np.linalg.norm(away[groups][seen[groups], 1:], axis=1).mean()
        if seen.any():
            cues["lightness"][i, j] = np.abs(away[seen, 0]).mean()
    return cues, turns


def place_cues(one: PhotoPeople, two: PhotoPeople, motion: Pose, turns: FloatArray) -> dict[str, FloatArray]:
    """Compare the places and directions of the people of two photos under a motion between the cameras.

    Returns:
        The cues (N, M) "place", the distance of the pelvis from where the other photo has it, as a share of the mean
        distance from both cameras; and "turn", the angle between the rotation that a pair gives and that of the motion,
        degrees.
    """
    there = motion.to_camera(one.joints[:, _PELVIS])
    apart = np.linalg.norm(there[:, None] - two.joints[None, :, _PELVIS], axis=-1)
    reach = (one.joints[:, _PELVIS, 2][:, None] + two.joints[:, _PELVIS, 2][None]) / 2
    return {"place": apart / reach, "turn": angle_deg(turns, motion.rotation)}


def relative_motion(one: PhotoPeople, two: PhotoPeople, pairs: Sequence[tuple[int, int, float]]) -> Pose:
    """Return the motion between the cameras that fits matched people: turns by their poses, and by their places."""
    i, j = (np.array([pair[k] for pair in pairs], np.int64) for k in (0, 1))
    a, b = one.joints[i, :_BODY], two.joints[j, :_BODY]
    inner = [x - x[:, :1] for x in (a, b)]
    outer = [x[:, 0] - x[:, 0].mean(axis=0) for x in (a, b)]
    source, target = (np.concatenate([x.reshape(-1, 3), y]) for x, y in zip(inner, outer, strict=True))
    # Places have the error of depth, poses that of limbs.
    weight = np.concatenate([np.ones(inner[0].size // 3), np.full(len(pairs), 2.0)])
    rotation = fit_rotation(source, target, weight)
    return Pose(rotation, np.median(two.joints[j, _PELVIS] - one.joints[i, _PELVIS] @ rotation.T, axis=0))


def _contradict(one: PairMatch, two: PairMatch) -> bool:
    """Return whether two assignments give a person different partners."""
    return any((i == k) != (j == m) for i, j, _ in one.pairs for k, m, _ in two.pairs)


def _score(
    pairs: Sequence[tuple[int, int, float]], accept: float, motion: Pose, background: BackgroundTurn | None
) -> float:
    """Return the score of matched people under a motion."""
    if not pairs:
        return 0.0
    by_background = 0.0 if background is None else background.supports(motion.rotation)
    return float(sum(own - accept for *_, own in pairs)) + by_background


def _llr(cues: dict[str, FloatArray], start: FloatArray) -> FloatArray:
    tables = measured_errors().cues
    return sum((tables[name](values) for name, values in cues.items()), start)


def _place_llr(
    one: PhotoPeople, two: PhotoPeople, motion: Pose, turns: FloatArray, pairs: Sequence[tuple[int, int, float]]
) -> FloatArray:
    """Return the LLR (N, M) of places and turns under the motion of some pairs.

    The motion fits these pairs better than others, and a single pair without error.
    """
    cues = place_cues(one, two, motion, turns)
    i, j = (np.array([pair[k] for pair in pairs], np.int64) for k in (0, 1))
    for values in cues.values():
        values[i, j] *= len(pairs) / (len(pairs) - 1) if len(pairs) > 1 else np.nan
    return _llr(cues, np.zeros(turns.shape[:2]))


def _assign(llr: FloatArray, accept: float) -> list[tuple[int, int, float]]:
    """Return the assignment with the largest sum of LLRs over acceptance; pairs below it stay apart."""
    rows, columns = linear_sum_assignment(np.maximum(llr, accept), maximize=True)
    return [(int(i), int(j), float(llr[i, j])) for i, j in zip(rows, columns, strict=True) if llr[i, j] > accept]
