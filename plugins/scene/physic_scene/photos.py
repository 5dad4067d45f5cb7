"""The photos of a moment as given, the choice of those that take part, and the matched people in
them.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError
from physic_core.types import ShortRepr
from physic_scene.observations import PhotoPeople, observe
from physic_scene.person_matching import PairMatch, join_tracks, joined_matches, match_pair
from physic_scene.types import SkippedPhoto

if TYPE_CHECKING:
    from physic_core.body import BodyModel
    from physic_core.types import FloatArray, IntArray, Reconstruction


@dataclass(frozen=True)
class ScenePhoto(ShortRepr):
    """One photo of the moment.

    Attributes:
        index: of the photo, as it was given.
        name: of the photo, for messages.
        result: reconstruction of the single photo.
        rows: (N,) index in ``result.people`` of each person who has a body.
        people: what the photo shows of these N people.
    """

    index: int
    name: str
    result: Reconstruction
    rows: tuple[int, ...]
    people: PhotoPeople

    @classmethod
    def of(
        cls,
        index: int,
        name: str,
        result: Reconstruction,
        model: BodyModel,
        statures: Sequence[float] = (),
        pose: FloatArray | None = None,
    ) -> ScenePhoto:
        """Return a photo from its reconstruction.

        Args:
            index: of the photo, as it was given.
            name: of the photo.
            result: of the single photo.
            model: body model of its people, float64.
            statures: known heights, metres: one for all, or of its people from left to right, 0
                where unknown.
            pose: (4, 4) from the frame of its camera to that of a calibrated rig, metres; None
                where unknown.
        """
        rows = tuple(i for i, person in enumerate(result.people) if person.has_body)
        known = np.full(len(rows), np.nan)
        if len(statures) and rows:
            middles = [result.people[i].box[0] + result.people[i].box[2] for i in rows]
            given = np.resize(np.asarray(statures, np.float64), len(rows))
            known[np.argsort(middles, kind="stable")] = np.where(given > 0, given, np.nan)
        return cls(index, name, result, rows, observe(result, rows, model, known, pose))

    def skipped(self, reason: str, why: str) -> SkippedPhoto:
        """Return the record of this photo as one that is not part of the solution."""
        return skipped_photo(self.index, self.name, reason, why)


def skipped_photo(index: int, name: str, reason: str, why: str) -> SkippedPhoto:
    """Return the record of a photo that is not part of the solution."""
    return SkippedPhoto(name, index, reason, f"{name} is skipped: {why}")


@dataclass(frozen=True)
class ChosenPhotos(ShortRepr):
    """Photos of one moment.

    Attributes:
        photos: V photos.
        rows: (P, V) row of each person in ``people`` of each photo, -1 where not shown; each in at
            least two photos.
        matches: of each pair of photos a < b.
        left_out: the other photos.
    """

    photos: tuple[ScenePhoto, ...]
    rows: IntArray
    matches: dict[tuple[int, int], PairMatch]
    left_out: tuple[SkippedPhoto, ...]

    def without(self, view: int, reason: str, why: str) -> ChosenPhotos:
        """Return a copy without one photo."""
        keep = [v for v in range(len(self.photos)) if v != view]
        number = {old: new for new, old in enumerate(keep)}
        rows = self.rows[:, keep]
        return ChosenPhotos(
            tuple(self.photos[v] for v in keep),
            rows[(rows >= 0).sum(1) > 1],
            {(number[a], number[b]): m for (a, b), m in self.matches.items() if view not in (a, b)},
            (*self.left_out, self.photos[view].skipped(reason, why)),
        )


def choose_photos(
    photos: Sequence[ScenePhoto], skipped: Sequence[SkippedPhoto] = ()
) -> ChosenPhotos:
    """Return the photos that show people, with the people matched.

    Args:
        photos: all that have a result.
        skipped: photos without one.

    Raises:
        InputError: fewer than two different photos show people.
    """
    left = list(skipped)
    kept_photos: list[ScenePhoto] = []
    first: dict[str, str] = {}  # digest of a photo -> its name
    for photo in photos:
        if not photo.rows:
            left.append(photo.skipped("no people", "no person in it has a body"))
        elif (twin := first.setdefault(photo.result.photo or photo.name, photo.name)) != photo.name:
            left.append(photo.skipped("same photo", f"it is the same picture as {twin}"))
        else:
            kept_photos.append(photo)
    if len(kept_photos) < 2:
        rest = f"only {kept_photos[0].name} is left" if kept_photos else "none is left"
        raise InputError(
            f"a moment needs two photos, and {rest}; {'; '.join(one.message for one in left)}: "
            "give two different photos that show the same people"
        )
    people = [photo.people for photo in kept_photos]
    matches = {
        (a, b): match_pair(people[a], people[b])
        for a, b in itertools.combinations(range(len(kept_photos)), 2)
    }
    rows = join_tracks(people, matches)
    return ChosenPhotos(
        tuple(kept_photos), rows, joined_matches(people, matches, rows), tuple(left)
    )
