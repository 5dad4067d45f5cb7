"""Several photos of calibrated rigs, without their cameras: who is joined, errors of cameras and
people, and grades.

A command of ``benchmarks.scene``. Moments of two and four photos are all those of the sets, and
wrong pairs are made of the photos of both sets. Three moments of panoptic gave the numbers of the
matching and the bounds of the checks of photos; the others, and roundtable, are reported apart.
Truth of who is who and of people's places is triangulated with the true cameras of all photos of a
moment.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.truth.sets import SETS, picture_of
from physic_bench.kept import kept
from physic_core.metrics import align_similarity

CHOSEN_ON = ("00004500", "00006859", "00013007")
"""Moments of panoptic on which numbers were chosen."""
WRONG_CHOSEN_ON = ("view_0", "view_1")
"""Photos of roundtable on which, in wrong pairs, bounds of checks were chosen."""
COUNTS = {"pairs": 2, "fours": 4}
SEEN = 0.3  # confidence of a keypoint
FEWEST = 4  # keypoints that two photos must share to say who is who
APART_M = 0.5  # at which the distance of two rays is cut
SAME_M = 0.25  # largest mean distance of the rays of one person
RIGHT_DEG = 20.0


@dataclass(frozen=True)
class RigPhoto:
    """One photo of a rig.

    Attributes:
        name: of the photo.
        moment: that it shows.
        camera: the true one, of the picture in the file.
        result: of the photo alone, without its camera.
        pixels: (N, J, 2) keypoints of its people, px of the picture in the file.
        confidence: (N, J).
    """

    name: str
    moment: str
    camera: Any
    result: Any
    pixels: Any
    confidence: Any


def run_rigs(data: Path, out: Path, kinds: Sequence[str], most: int, *, apart: bool) -> None:
    """Print the figures of each kind of moments, for those on which numbers were chosen, and for
    the others.

    Args:
        data: folder of the sets.
        out: folder of results of photos alone.
        kinds: of COUNTS, or "wrong".
        most: moments of each kind, spread over all.
        apart: whether only moments are used that took no part in choosing numbers.
    """
    from physic_core import load_config
    from physic_scene import ScenePipeline

    missing = [
        name for name in ("panoptic", "roundtable") if not (data / name / "cameras.json").is_file()
    ]
    if missing:
        print(
            f"skipped: {data} has no {' and no '.join(missing)}; they are sets of benchmarks.truth",
            file=sys.stderr,
        )
        return
    out.mkdir(parents=True, exist_ok=True)
    with ScenePipeline(load_config()) as scene:
        photos = list(_photos(scene, data, out))
        moments = {
            m: [p for p in photos if p.moment == m]
            for m in dict.fromkeys(photo.moment for photo in photos)
        }
        number = {m: who_is_who(own) for m, own in moments.items()}
        for kind in kinds:
            rows: dict[bool, list[dict[str, float]]] = {True: [], False: []}
            groups = list(_wrong(moments) if kind == "wrong" else _groups(moments, COUNTS[kind]))
            groups = [group for group in groups if not (apart and _took_part(group, kind))]
            for group in [
                groups[k]
                for k in np.unique(np.linspace(0, len(groups) - 1, most).round().astype(int))
            ]:
                chosen = _took_part(group, kind)
                truth = (
                    None
                    if kind == "wrong"
                    else _of(group, moments[group[0].moment], number[group[0].moment])
                )
                rows[chosen].append(_scores(scene, group, truth))
                print(
                    kind,
                    [photo.name for photo in group],
                    rows[chosen][-1],
                    file=sys.stderr,
                    flush=True,
                )
            for chosen, label in ((True, "numbers were chosen on these"), (False, "took no part")):
                _print(f"{kind}, {label}", rows[chosen])


def _photos(scene: Any, data: Path, out: Path) -> Iterator[RigPhoto]:
    """Yield the photos of both rigs, from results that are kept in a folder."""
    for name in ("panoptic", "roundtable"):
        for sample in SETS[name](data / name):

            def alone(sample: Any = sample) -> Any:
                return scene.alone(picture_of(sample)[..., ::-1].copy())

            result = kept(out / f"{name}-{sample.name}-free.pkl", alone)
            camera = sample.truth["camera"]
            # a large photo is reduced before it is reconstructed
            zoom = camera.width / result.intrinsics.width
            pixels = np.stack([zoom * (person.keypoints + 0.5) - 0.5 for person in result.people])
            confidence = np.stack([person.keypoint_confidence for person in result.people])
            yield RigPhoto(sample.name, sample.group, camera, result, pixels, confidence)


def _groups(
    moments: Mapping[str, Sequence[RigPhoto]], count: int
) -> Iterator[tuple[RigPhoto, ...]]:
    for photos in moments.values():
        yield from itertools.combinations(photos, count)


def _took_part(group: Sequence[RigPhoto], kind: str) -> bool:
    """Return whether numbers were chosen on a photo of a group; wrong pairs have a photo of each
    rig.
    """
    names = {photo.moment for photo in group} | (
        {photo.name for photo in group} if kind == "wrong" else set()
    )
    return not names.isdisjoint((*CHOSEN_ON, *WRONG_CHOSEN_ON))


def _wrong(moments: Mapping[str, Sequence[RigPhoto]]) -> Iterator[tuple[RigPhoto, ...]]:
    """Yield pairs of photos of different rigs."""
    *panoptic, roundtable = moments.values()
    yield from itertools.product(itertools.chain.from_iterable(panoptic), roundtable)


def who_is_who(photos: Sequence[RigPhoto]) -> list[list[int]]:
    """Return the number of each person of each photo, by the distances of their keypoints' rays
    with true cameras.

    The nearest people are joined first, as long as no photo shows a person twice.
    """
    people = [(v, i) for v, photo in enumerate(photos) for i in range(len(photo.pixels))]
    apart = {
        pair: _rays_apart(photos, *pair)
        for pair in itertools.combinations(people, 2)
        if pair[0][0] != pair[1][0]
    }
    groups = [[person] for person in people]
    while True:
        near: list[tuple[float, int, int]] = []
        for g, h in itertools.combinations(range(len(groups)), 2):
            if not {v for v, _ in groups[g]} & {v for v, _ in groups[h]}:
                found = [apart[min(a, b), max(a, b)] for a in groups[g] for b in groups[h]]
                known = [distance for distance in found if np.isfinite(distance)]
                near += [(float(np.mean(known)), g, h)] if known else []
        if not near or min(near)[0] > SAME_M:
            break
        _, g, h = min(near)
        groups[g] += groups.pop(h)
    number = {person: k for k, group in enumerate(groups) for person in group}
    return [[number[v, i] for i in range(len(photo.pixels))] for v, photo in enumerate(photos)]


def _rays_apart(photos: Sequence[RigPhoto], one: tuple[int, int], two: tuple[int, int]) -> float:
    """Return the mean distance of the rays of the keypoints of two people, metres; NaN with too
    few.
    """
    (a, i), (b, j) = one, two
    both = (photos[a].confidence[i] > SEEN) & (photos[b].confidence[j] > SEEN)
    if both.sum() < FEWEST:
        return float("nan")
    first, second = (_rays(photos[v], k)[both] for v, k in (one, two))
    normal = np.cross(first, second)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    return float(
        np.minimum(
            np.abs(normal @ (photos[b].camera.centre - photos[a].camera.centre)), APART_M
        ).mean()
    )


def _rays(photo: RigPhoto, person: int) -> Any:
    """Return the directions (J, 3) of a person's keypoints in the frame of the rig."""
    pixels = np.column_stack([photo.pixels[person], np.ones(len(photo.pixels[person]))])
    rays = pixels @ np.linalg.inv(photo.camera.K).T @ photo.camera.R
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


@dataclass(frozen=True)
class RigTruth:
    """What is true of the photos of a group: numbers of their people, and their hips (3,), metres,
    frame of the rig.
    """

    number: list[list[int]]
    hips: dict[int, Any]


def _of(
    group: Sequence[RigPhoto], moment: Sequence[RigPhoto], number: Sequence[list[int]]
) -> RigTruth:
    """Return the truth of a group of photos, with people whom at least three photos of the moment
    show.
    """
    views: dict[int, list[tuple[RigPhoto, int]]] = {}
    for photo, own in zip(moment, number, strict=True):
        for i, person in enumerate(own):
            views.setdefault(person, []).append((photo, i))
    hips = {
        p: found for p, seen in views.items() if (found := _triangulated_hips(seen)) is not None
    }
    return RigTruth([number[list(moment).index(photo)] for photo in group], hips)


def _triangulated_hips(seen: Sequence[tuple[RigPhoto, int]]) -> Any:
    """Return the point between both hips, from all photos that show them; None with fewer than
    three.
    """
    points = []
    for name in ("left_hip", "right_hip"):
        left = np.zeros((3, 3))
        right = np.zeros(3)
        count = 0
        for photo, i in seen:
            k = _skeleton(photo.result).index(name)
            if photo.confidence[i, k] > SEEN:
                ray = _rays(photo, i)[k]
                across = np.eye(3) - np.outer(ray, ray)
                left = left + across
                right = right + across @ photo.camera.centre
                count = count + 1
        if count < 3:
            return None
        points.append(np.linalg.solve(left, right))
    return np.mean(points, axis=0)


def _skeleton(result: Any) -> list[str]:
    from physic_core.types import skeleton_named

    return list(skeleton_named(result.skeleton).names)


def _scores(scene: Any, group: Sequence[RigPhoto], truth: RigTruth | None) -> dict[str, float]:
    """Return the figures of one moment; truth is None for photos of different rigs."""
    from physic_core.errors import InputError
    from physic_core.types import Grade

    try:
        found = scene.join([photo.result for photo in group], [photo.name for photo in group])
    except InputError:
        return {"refused": 1.0} | (
            {} if truth is None else {"right people": 0.0, "and cameras": 0.0}
        )
    views = [check for check in found.reconstruction.checks if check.name.startswith("view_")]
    failed = {check.name for check in views if check.failed}
    scores = {
        "refused": 0.0,
        "cameras good": float(not failed),
        "cameras bad": float(len(failed) > 1),
        "result good": float(found.reconstruction.grade is Grade.GOOD),
        "result bad": float(found.reconstruction.grade is Grade.BAD),
    }
    if truth is None:
        return scores
    people = [
        {
            truth.number[photo.index][photo.shown[row]]
            for photo in found.photos
            if row in photo.shown
        }
        for row in range(len(found.reconstruction.people))
    ]
    reference = group[found.reference].camera
    turns = [
        _turn_deg(p.camera.rotation @ reference.R @ group[p.index].camera.R.T) for p in found.photos
    ]
    right = all(len(own) < 2 for own in people)
    near = max(turns) < RIGHT_DEG and len(found.photos) == len(group)
    scores |= {"right people": float(right), "and cameras": float(right and near)}
    scores |= {
        f"of these {name}": scores[name]
        for name in ("cameras good", "cameras bad")
        if right and near
    }
    return scores | _hips(found, group, truth, people)


def _hips(
    found: Any, group: Sequence[RigPhoto], truth: RigTruth, people: Sequence[set[int]]
) -> dict[str, float]:
    """Return the errors of hips, mm, after one similarity, and of single photos placed by the true
    cameras.
    """
    from physic_core.body import JOINT_INDEX

    left = JOINT_INDEX["left_hip"]
    right = JOINT_INDEX["right_hip"]
    own = []
    single = []
    fact = []
    for row, numbers in enumerate(people):
        solved = sum(row in photo.shown for photo in found.photos) > 1
        for number in numbers & truth.hips.keys() if solved and len(numbers) == 1 else ():
            shown = [
                photo.camera.in_world(
                    photo.result.people[i].joints[[left, right]].astype(np.float64).mean(0)
                )
                for photo, own_numbers in zip(group, truth.number, strict=True)
                for i, other in enumerate(own_numbers)
                if other == number
            ]
            own.append(found.reconstruction.people[row].joints[[left, right]].mean(0))
            single.append(np.mean(shown, axis=0))
            fact.append(truth.hips[number])
    if not own:
        return {}
    # Centres of cameras take part in the similarity: two people alone would fit any.
    centres = [photo.camera.centre for photo in found.photos]
    true = [group[photo.index].camera.centre for photo in found.photos]
    moved = align_similarity(np.array([*own, *centres]), np.array([*fact, *true]))[: len(own)]
    away, alone = (np.linalg.norm(np.array(x) - fact, axis=1).mean() for x in (moved, single))
    return {"hips mm": 1000 * float(away), "hips of single photos mm": 1000 * float(alone)}


def _turn_deg(rotation: Any) -> float:
    return float(np.degrees(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))))


def _print(title: str, rows: Sequence[Mapping[str, float]]) -> None:
    """Print the mean of each figure, and the number of moments that have it."""
    for name in dict.fromkeys(key for row in rows for key in row):
        values = [row[name] for row in rows if name in row]
        print(f"| {title} | {name} | {np.mean(values):.3g} | {len(values)} |")
