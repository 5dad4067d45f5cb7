"""Which photos show the same moment, and who is who in them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import JOINT_NAMES
from physic_core.errors import InputError
from physic_core.types.short_repr import ShortRepr
from physic_scene.background import Background, BackgroundSettings, is_mirrored, match_background, same_photo, sees
from physic_scene.matching import MatchingSettings, PairMatch, join_tracks, joined_matches, match_pair
from physic_scene.types import LeftOut

if TYPE_CHECKING:
    from physic_core.types import IntArray, Reconstruction
    from physic_scene.bundle import PixelMatches
    from physic_scene.observations import PhotoPeople

__all__ = ["ChosenPhotos", "Photo", "select_photos"]


@dataclass(frozen=True)
class Photo(ShortRepr):
    """One photo, its result alone, and its people.

    Attributes:
        index: of the photo, as it was given.
        name: for messages.
        result: reconstruction of the photo alone.
        people: those who have a body.
    """

    index: int
    name: str
    result: Reconstruction
    people: PhotoPeople


@dataclass(frozen=True)
class ChosenPhotos(ShortRepr):
    """Photos of one moment.

    Attributes:
        photos: V photos.
        rows: (P, V) row of each person in ``people`` of each photo, -1 where not shown; each in at least two photos.
        matches: of each pair of photos a < b.
        background: matched pixels of pairs of photos.
        left_out: the other photos.
    """

    photos: tuple[Photo, ...]
    rows: IntArray
    matches: dict[tuple[int, int], PairMatch]
    background: tuple[PixelMatches, ...]
    left_out: tuple[LeftOut, ...]

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
            tuple(
                replace(m, views=(number[m.views[0]], number[m.views[1]]))
                for m in self.background
                if view not in m.views
            ),
            (*self.left_out, _left_out(photo.index, photo.name, reason, why)),
        )


def select_photos(
    photos: Sequence[Photo], names: Sequence[str], matching: MatchingSettings, settings: BackgroundSettings
) -> ChosenPhotos:
    """Return the photos that show the same people at the same moment.

    Args:
        photos: with a result.
        names: of all photos, as they were given.
        matching: settings of the people's match.
        settings: of the background's match.

    Raises:
        InputError: no two photos share a person.
    """
    given = {photo.index for photo in photos}
    left = [_left_out(i, name, "no people", "nobody was found in it") for i, name in enumerate(names) if i not in given]
    kept: list[Photo] = []
    seen: list[Background] = []
    for photo in photos:
        if not len(photo.people):
            left.append(_left_out(photo.index, photo.name, "no people", "nobody in it has a body"))
            continue
        background = sees(photo.result, settings)
        twin = next((k.name for k, s in zip(kept, seen, strict=True) if same_photo(s, background)), None)
        if twin is not None:
            left.append(_left_out(photo.index, photo.name, "same photo", f"it is the same picture as {twin}"))
            continue
        kept.append(photo)
        seen.append(background)
    if len(kept) < 2:
        raise _no_common_person([photo.name for photo in kept], left)
    pairs = list(itertools.combinations(range(len(kept)), 2))
    pixels = {(a, b): match_background(seen[a], seen[b], (a, b), settings) for a, b in pairs}
    mirrors = {(a, b): is_mirrored(seen[a], seen[b], pixels[a, b], settings) for a, b in pairs}
    matches = {(a, b): match_pair(kept[a].people, kept[b].people, matching) for a, b in pairs}
    people = [photo.people for photo in kept]
    rows = join_tracks(people, matches, matching).rows
    found = ChosenPhotos(
        tuple(kept),
        rows,
        joined_matches(people, matches, rows, matching),
        tuple(m for m in pixels.values() if m is not None),
        tuple(left),
    )
    for view in reversed(_mirrored_views(kept, matches, mirrors, matching)):
        found = found.without(
            view, "mirrored", "it is mirrored: left and right are swapped in its people or background"
        )
    return _connected(found)


def _mirrored_views(
    photos: Sequence[Photo],
    matches: dict[tuple[int, int], PairMatch],
    mirrors: dict[tuple[int, int], bool],
    settings: MatchingSettings,
) -> list[int]:
    """Return the photos that fit the others better in a mirror, by their people or by their background."""
    views = range(len(photos))
    by_background = [sum(mirrors[min(a, b), max(a, b)] for b in views if b != a) for a in views]
    found = []
    for a in views:
        others = [b for b in views if b != a]
        upright = sum(matches[min(a, b), max(a, b)].score for b in others)
        turned = mirrored(photos[a].people)
        in_mirror = sum(match_pair(turned, photos[b].people, settings).score for b in others)
        by_people = in_mirror > upright + settings.mirrored
        # Of two photos that mirror each other, the later one is left out.
        majority = by_background[a] > len(others) / 2 or (len(views) == 2 and by_background[a] and a == 1)
        if (by_people and (len(views) > 2 or a == 1)) or majority:
            found.append(a)
    return found if len(found) < len(views) else []


def mirrored(people: PhotoPeople) -> PhotoPeople:
    """Return the people of the mirror image of a photo, as far as matching uses them."""
    swap = [JOINT_NAMES.index(_other_side(name)) for name in JOINT_NAMES]
    return replace(people, joints=people.joints[:, swap] * [-1, 1, 1])


def _other_side(name: str) -> str:
    side, _, rest = name.partition("_")
    return {"left": f"right_{rest}", "right": f"left_{rest}"}.get(side, name)


def _connected(chosen: ChosenPhotos) -> ChosenPhotos:
    """Return the largest group of photos that are joined by people.

    Raises:
        InputError: no two photos share a person.
    """
    views = len(chosen.photos)
    group = list(range(views))
    for row in chosen.rows:
        members = {group[v] for v in np.flatnonzero(row >= 0)}
        group = [min(members) if g in members else g for g in group]
    score = {
        g: (sum(m.score for (a, b), m in chosen.matches.items() if group[a] == group[b] == g), group.count(g))
        for g in set(group)
    }
    best = max(score, key=lambda g: (score[g][1] > 1, *score[g]))
    if group.count(best) < 2:
        raise _no_common_person([photo.name for photo in chosen.photos], chosen.left_out)
    for view in reversed([v for v in range(views) if group[v] != best]):
        chosen = chosen.without(view, "other people", "it shares no person with the other photos, in this pose")
    return chosen


def _no_common_person(names: Sequence[str], left: Sequence[LeftOut]) -> InputError:
    others = "".join(f"; {one.message}" for one in left)
    return InputError(
        f"no two of the photos show the same person in the same pose ({', '.join(names)}){others}: give photos that "
        "were taken at the same moment, or of people who hold still, and that have at least one person in common"
    )


def _left_out(index: int, name: str, reason: str, why: str) -> LeftOut:
    return LeftOut(name, index, reason, f"{name} is left out: {why}")
