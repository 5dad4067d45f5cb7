"""What contradicts the solved cameras, of each photo: shown, not refused, since the user says that it is one moment.

The bounds are those of the checks ``view_people``, ``view_agreement``, ``view_missing_person`` and ``view_height``.
They were chosen on 30 pairs of photos of a rig, and on 30 pairs of photos of that rig and of another one.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_scene.matching import answer_cost

if TYPE_CHECKING:
    from physic_core.types import FloatArray, IntArray
    from physic_scene.observations import PhotoPeople
    from physic_scene.rigid import CameraPose
    from physic_scene.settings import MomentSettings, VerdictSettings

_NEAREST_M = 0.5  # of somebody whom a photo may show


@dataclass(frozen=True)
class SolvedView:
    """One photo of a solved moment.

    Attributes:
        name: of the photo.
        people: whom it shows.
        pose: of its camera, metres.
        K: (3, 3) px, of the solved camera.
        size: (width, height) px.
        floor: (4,) normal and offset of the floor of the photo alone, metres, in the frame of its camera; None without.
    """

    name: str
    people: PhotoPeople
    pose: CameraPose
    K: FloatArray
    size: tuple[int, int]
    floor: FloatArray | None


def view_contradictions(
    views: Sequence[SolvedView], rows: IntArray, settings: MomentSettings
) -> Iterator[tuple[str, str, float | None, str]]:
    """Yield photo, check, value and advice of each check of each photo.

    Args:
        views: V photos.
        rows: (P, V) row of each solved person in each photo, -1 where not shown.
        settings: of all steps.
    """
    costs = _costs(views, rows, settings)
    for v, view in enumerate(views):
        look = f"look at the row of {view.name} in preview.png; if it is wrong, leave the photo out"
        held = int((rows[:, v] >= 0).sum())
        yield view.name, "view_people", held, f"one person alone holds the camera of {view.name}: {look}"
        cost = min((cost for pair, cost in costs.items() if v in pair), default=None)
        why = f"the people of {view.name} are unlike those of the other photos in pose, place or clothes: {look}"
        yield view.name, "view_agreement", cost, why
        nobody = sum(_shows_nobody(view, other, row, settings.verdict) for other, row in _others(views, rows, v))
        why = f"{view.name} shows no person where other photos show one: {look}"
        yield view.name, "view_missing_person", nobody, why
        heights = [abs(h) for w in range(len(views)) if w != v and (h := _height(view, views[w])) is not None]
        why = f"the camera of {view.name} is not as high over its floor as over those of the other photos: {look}"
        yield view.name, "view_height", float(np.median(heights)) if heights else None, why


def _costs(views: Sequence[SolvedView], rows: IntArray, settings: MomentSettings) -> Mapping[tuple[int, int], float]:
    """Return what the people cost, on average, of each two photos that share people."""
    found = {}
    for a, b in itertools.combinations(range(len(views)), 2):
        pairs = tuple((int(row[a]), int(row[b])) for row in rows if row[a] >= 0 and row[b] >= 0)
        if pairs:
            motion = views[b].pose.after(views[a].pose.inverse())
            people = views[a].people, views[b].people
            cost, _ = answer_cost(*people, pairs, motion, settings.matching, settings.bundle)
            found[a, b] = cost / len(pairs)
    return found


def _others(views: Sequence[SolvedView], rows: IntArray, v: int) -> Iterator[tuple[SolvedView, int]]:
    """Yield the people whom other photos show and this one does not, each once."""
    for w, other in enumerate(views):
        for row in range(len(other.people)) if w != v else ():
            shown = rows[rows[:, w] == row]
            if not len(shown) or (shown[0, v] < 0 and np.flatnonzero(shown[0] >= 0)[0] == w):
                yield other, row


def _shows_nobody(view: SolvedView, other: SolvedView, row: int, settings: VerdictSettings) -> bool:
    """Return whether a photo has nobody where another photo has a person, who is within its frame."""
    zoom = other.K[0, 0] / other.people.K[0, 0]
    points = view.pose.to_camera(other.pose.to_common(other.people.landmarks[row] * [1, 1, zoom]))
    if np.median(points[:, 2]) < _NEAREST_M:
        return False
    pixels = points @ view.K.T
    pixels = pixels[:, :2] / np.maximum(pixels[:, 2:], _NEAREST_M / 10)
    if ((pixels >= 0) & (pixels < view.size)).all(1).mean() < settings.inside:
        return False
    away = np.linalg.norm(np.median(view.people.points, axis=1) - np.median(pixels, axis=0), axis=1)
    return bool((away > settings.nobody * view.people.size_px).all())


def _height(view: SolvedView, other: SolvedView) -> float | None:
    """Return the logarithm of a camera's height over another photo's floor, over that over its own floor."""
    if view.floor is None or other.floor is None:
        return None
    height = other.floor[:3] @ other.pose.to_camera(view.pose.centre) + other.floor[3]
    return float(np.log(max(height, 0.1) / max(view.floor[3], 0.1)))
