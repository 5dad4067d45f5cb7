"""Which photos show the same moment, and who is who in them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from physic_core.errors import InputError
from physic_core.types import SkippedPhoto
from physic_core.types.short_repr import ShortRepr
from physic_scene.matching import PairMatch, join_tracks, joined_matches, match_pair
from physic_scene.twins import thumbnail, thumbnails_match

if TYPE_CHECKING:
    from physic_core.types import FloatArray, IntArray, Intrinsics, MomentView
    from physic_scene.observations import PhotoPeople
    from physic_scene.settings import MomentSettings


@dataclass(frozen=True)
class PhotoWithPeople(ShortRepr):
    """One photo, and its people.

    Attributes:
        index: of the photo, as it was given.
        view: what it shows by itself.
        people: those of the view.
    """

    index: int
    view: MomentView
    people: PhotoPeople

    @property
    def name(self) -> str:
        """Name of the photo, for messages."""
        return self.view.name


@dataclass(frozen=True)
class ChosenPhotos(ShortRepr):
    """Photos of one moment.

    Attributes:
        photos: V photos.
        rows: (P, V) row of each person in ``people`` of each photo, -1 where not shown; each in at least two photos.
        matches: of each pair of photos a < b.
        left_out: the other photos.
        intrinsics: of all photos, as they were given.
    """

    photos: tuple[PhotoWithPeople, ...]
    rows: IntArray
    matches: dict[tuple[int, int], PairMatch]
    left_out: tuple[SkippedPhoto, ...]
    intrinsics: tuple[Intrinsics, ...]

    def without(self, view: int, reason: str, why: str) -> ChosenPhotos:
        """Return a copy without one photo."""
        photo = self.photos[view]
        keep = [v for v in range(len(self.photos)) if v != view]
        number = {old: new for new, old in enumerate(keep)}
        rows = self.rows[:, keep]
        return ChosenPhotos(
            tuple(self.photos[v] for v in keep),
            rows[(rows >= 0).sum(1) > 1],
            {(number[a], number[b]): m for (a, b), m in self.matches.items() if view not in (a, b)},
            (*self.left_out, _skipped_photo(photo.index, photo.name, reason, why)),
            self.intrinsics,
        )


def select_photos(photos: Sequence[PhotoWithPeople], settings: MomentSettings) -> ChosenPhotos:
    """Return the photos that show people, and who is who in them.

    Args:
        photos: all, as they were given.
        settings: of all steps.

    Raises:
        InputError: fewer than two different photos show people.
    """
    left: list[SkippedPhoto] = []
    kept: list[PhotoWithPeople] = []
    seen: list[FloatArray] = []
    for photo in photos:
        if not len(photo.people):
            left.append(_skipped_photo(photo.index, photo.name, "no people", "no person in it has a body"))
            continue
        picture = thumbnail(photo.view)
        twin = next((k.name for k, s in zip(kept, seen, strict=True) if thumbnails_match(s, picture)), None)
        if twin is not None:
            left.append(_skipped_photo(photo.index, photo.name, "same photo", f"it is the same picture as {twin}"))
            continue
        kept.append(photo)
        seen.append(picture)
    if len(kept) < 2:
        rest = f"only {kept[0].name} is left" if kept else "none is left"
        raise InputError(
            f"a moment needs two photos, and {rest}; {'; '.join(one.message for one in left)}: give two different "
            "photos that show the same people"
        )
    matches = {}
    for a, b in itertools.combinations(range(len(kept)), 2):
        matches[a, b] = match_pair(kept[a].people, kept[b].people, settings.matching, settings.bundle)
    people = [photo.people for photo in kept]
    rows = join_tracks(people, matches)
    cameras = tuple(photo.view.intrinsics for photo in photos)
    return ChosenPhotos(tuple(kept), rows, joined_matches(people, matches, rows), tuple(left), cameras)


def _skipped_photo(index: int, name: str, reason: str, why: str) -> SkippedPhoto:
    return SkippedPhoto(name, index, reason, f"{name} is skipped: {why}")
