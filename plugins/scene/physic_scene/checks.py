"""Checks of each photo against the solved cameras.

A failure is shown, not refused: the user states one moment.

The bounds were chosen on 30 pairs of photos of a rig, and on 30 pairs of photos of that rig and of
another one.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.judge import CheckSpec, capped_by_contradictions, limb_keypoint_error
from physic_scene.person_matching import pairs_cost

if TYPE_CHECKING:
    from physic_core.types import CheckResult, FloatArray, IntArray, Plane, Reconstruction
    from physic_scene.observations import PhotoPeople
    from physic_scene.rigid import CameraPose
    from physic_scene.types import SolvedPhoto

_CHECKS = {
    check.name: check
    for check in (
        # Worlds 0.015-0.033, photos 0.035-0.044; 0.15 in a photo whose camera is 0.3 m off and
        # whose people do not fit.
        CheckSpec(
            "view_keypoints",
            "Limbs far from their keypoints",
            "at most",
            0.06,
            share_of="the box diagonal",
        ),
        # Of 30 pairs of photos of a rig, 20 have two or three people, and 29 of 30 wrong pairs of
        # two rigs one.
        CheckSpec("view_people", "People also in other photos", "at least", 2, "count"),
        # Half of the energy of a person in the solution of two photos, with the clothes: rigs
        # 11-29, wrong pairs 17-47.
        CheckSpec("view_agreement", "People differ from other photos", "at most", 28, "energy"),
        CheckSpec("view_missing_person", "Person of other photos missing", "at most", 0, "count"),
        # Rigs 0.05-0.56; 0.6-0.9 where a floor is wrong, 2.6 in a wrong pair.
        CheckSpec("view_height", "Camera height differs from other floors", "at most", 0.6, "log"),
    )
}
# Least share of a person's keypoints in the frame of a photo that should show the person.
_INSIDE = 0.9
# Least distance from other people of an empty place, in statures in px.
_NOBODY = 0.4
_NEAREST_M = 0.5  # of a person whom a photo may show


@dataclass(frozen=True)
class SolvedView:
    """One photo of a solved moment.

    Attributes:
        name: of the photo.
        people: whom it shows.
        pose: of its camera, metres.
        K: (3, 3) px, of the solved camera.
        size: (width, height) px.
        floor: of the single photo, metres, in the frame of its camera; None without.
    """

    name: str
    people: PhotoPeople
    pose: CameraPose
    K: FloatArray
    size: tuple[int, int]
    floor: Plane | None


def with_checks(result: Reconstruction, checks: Sequence[CheckResult]) -> Reconstruction:
    """Return a result with checks of its photos, their warnings, and the trust that is left.

    A failed check contradicts the place of all people. One that fails in several photos counts
    once.
    """
    failed = {check.name for check in checks if check.failed}
    people = tuple(
        replace(
            person,
            trust=_capped(person.trust, len(failed)),
            trust_place=_capped(person.trust_place, len(failed)),
        )
        for person in result.people
    )
    return replace(
        result,
        checks=(*result.checks, *checks),
        warnings=(*result.warnings, *(check.message for check in checks if check.failed)),
        people=people,
    )


def _capped(trust: float | None, failures: int) -> float | None:
    return None if trust is None else capped_by_contradictions(trust, failures)


def checks_of_keypoints(
    result: Reconstruction, photos: Iterable[SolvedPhoto]
) -> Iterator[CheckResult]:
    """Yield the check of each photo but the reference that its people are where it shows them."""
    for photo in photos:
        errors = []
        for row, photo_row in photo.shown.items():
            people = photo.result.people[photo_row]
            joints = photo.camera.to_camera(result.people[row].joints)
            keypoints = (people.keypoints, people.keypoint_confidence)
            box = np.asarray(people.box, np.float64)
            errors.append(
                limb_keypoint_error(
                    joints, *keypoints, box, result.skeleton, photo.camera.intrinsics
                )
            )
        measured = [error for error in errors if error is not None]
        yield _check(
            photo.name,
            "view_keypoints",
            float(np.median(measured)) if measured else None,
            f"the people are not where {photo.name} shows them: its camera is wrong, or the people "
            "moved; look at its row in photos.png, and leave the photo out",
            f"no person has enough confident keypoints in {photo.name}",
        )


def checks_of_cameras(views: Sequence[SolvedView], rows: IntArray) -> Iterator[CheckResult]:
    """Yield the checks of each photo's camera.

    Args:
        views: V photos.
        rows: (P, V) row of each solved person in each photo, -1 where not shown.
    """
    costs = _cost_of_pairs(views, rows)
    for v, view in enumerate(views):
        look = f"look at the row of {view.name} in photos.png; if it is wrong, leave the photo out"
        held = int((rows[:, v] >= 0).sum())
        yield _check(
            view.name,
            "view_people",
            held,
            f"a single person determines the camera of {view.name}: {look}",
        )
        cost = min((cost for pair, cost in costs.items() if v in pair), default=None)
        why = (
            f"the people of {view.name} are unlike those of the other photos in pose, place or "
            f"clothes: {look}"
        )
        yield _check(view.name, "view_agreement", cost, why)
        empty = sum(
            _shows_no_person(view, other, row)
            for other, row in _people_missing_here(views, rows, v)
        )
        why = f"{view.name} shows no person where other photos show one: {look}"
        yield _check(view.name, "view_missing_person", empty, why)
        heights = [
            abs(h)
            for w in range(len(views))
            if w != v and (h := _log_height_ratio(view, views[w])) is not None
        ]
        why = (
            f"the camera of {view.name} is not as high over its floor as over those of the "
            f"other photos: {look}"
        )
        yield _check(view.name, "view_height", float(np.median(heights)) if heights else None, why)


def _check(
    photo: str, name: str, value: float | None, advice: str, unmeasured: str = ""
) -> CheckResult:
    """Return a value beside its bound, with the name of its photo; the message of a failure has
    both.
    """
    spec = replace(_CHECKS[name], label=f"{_CHECKS[name].label} in {photo}")
    check = spec.compare((value, unmeasured if value is None else advice))
    return (
        replace(check, message=f"{advice} ({check.value_text}, {check.bound_text})")
        if check.failed
        else check
    )


def _cost_of_pairs(views: Sequence[SolvedView], rows: IntArray) -> Mapping[tuple[int, int], float]:
    """Return the mean cost of the people of each pair of photos that share people."""
    costs = {}
    for a, b in itertools.combinations(range(len(views)), 2):
        pairs = tuple((int(row[a]), int(row[b])) for row in rows if row[a] >= 0 and row[b] >= 0)
        if pairs:
            motion = views[b].pose.after(views[a].pose.inverse())
            cost, _ = pairs_cost(views[a].people, views[b].people, pairs, motion)
            costs[a, b] = cost / len(pairs)
    return costs


def _people_missing_here(
    views: Sequence[SolvedView], rows: IntArray, v: int
) -> Iterator[tuple[SolvedView, int]]:
    """Yield the people whom other photos show and this one does not, each once."""
    for w, other in enumerate(views):
        for row in range(len(other.people)) if w != v else ():
            shown = rows[rows[:, w] == row]
            if not len(shown) or (shown[0, v] < 0 and np.flatnonzero(shown[0] >= 0)[0] == w):
                yield other, row


def _shows_no_person(view: SolvedView, other: SolvedView, row: int) -> bool:
    """Return whether a photo has no person in a place within its frame where another photo has
    one.
    """
    zoom = other.K[0, 0] / other.people.K[0, 0]
    points = view.pose.to_camera(other.pose.to_common(other.people.landmarks[row] * [1, 1, zoom]))
    if np.median(points[:, 2]) < _NEAREST_M:
        return False
    pixels = points @ view.K.T
    pixels = pixels[:, :2] / np.maximum(pixels[:, 2:], _NEAREST_M / 10)
    if ((pixels >= 0) & (pixels < view.size)).all(1).mean() < _INSIDE:
        return False
    away = np.linalg.norm(np.median(view.people.points, axis=1) - np.median(pixels, axis=0), axis=1)
    return bool((away > _NOBODY * view.people.size_px).all())


def _log_height_ratio(view: SolvedView, other: SolvedView) -> float | None:
    """Return the logarithm of the ratio of a camera's heights, over another photo's floor and its
    own.
    """
    if view.floor is None or other.floor is None:
        return None
    above = float(other.floor.normal @ other.pose.to_camera(view.pose.centre))
    height = above + other.floor.offset
    return float(np.log(max(height, 0.1) / max(view.floor.offset, 0.1)))
