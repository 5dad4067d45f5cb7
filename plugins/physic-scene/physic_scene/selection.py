"""Which photos show the same moment, and who is who in them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError
from physic_core.types.short_repr import ShortRepr
from physic_scene.background import Background, BackgroundSettings, background_turn, same_photo, sees
from physic_scene.bundle import PixelMatches
from physic_scene.matching import MatchingSettings, PairMatch, join_tracks, joined_matches, match_pair
from physic_scene.types import LeftOut

if TYPE_CHECKING:
    from physic_core.types import IntArray, Reconstruction
    from physic_scene.observations import PhotoPeople

_CLEARER = "add a photo from a direction between the others, or one in which people wear clothes of different colours"


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
        left_out: the other photos.
    """

    photos: tuple[Photo, ...]
    rows: IntArray
    matches: dict[tuple[int, int], PairMatch]
    left_out: tuple[LeftOut, ...]

    @property
    def background(self) -> tuple[PixelMatches, ...]:
        """Matched pixels of pairs of photos that certainly show the same background."""
        turns = {pair: match.background for pair, match in self.matches.items()}
        return tuple(
            PixelMatches(pair, turn.first, turn.second)
            for pair, turn in turns.items()
            if turn is not None and len(turn.first)
        )

    def first(self, sizes: str) -> Photo:
        """Return the photo that was given first, whose people have known sizes, such as "ages".

        Raises:
            InputError: it is skipped.
        """
        if self.photos[0].index:
            why = next(one.message for one in self.left_out if one.index == 0)
            raise InputError(f"the {sizes} are those of people of the first photo, but {why}; put another photo first")
        return self.photos[0]

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
        InputError: no two photos share a person, or who is who is ambiguous in all pairs of photos.
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
        rest = f"only {kept[0].name} is left" if kept else "none is left"
        raise InputError(
            f"a moment needs two photos, and {rest}; {'; '.join(one.message for one in left)}: give two different "
            "photos that show the same people"
        )
    matches = {}
    for a, b in itertools.combinations(range(len(kept)), 2):
        one, two = kept[a].people, kept[b].people
        turn = background_turn(seen[a], seen[b], (one.K, two.K), settings)
        matches[a, b] = match_pair(one, two, matching, turn)
    no_rows = np.empty((0, len(kept)), np.int64)
    return _joined(ChosenPhotos(tuple(kept), no_rows, matches, tuple(left)), matching)


def _joined(chosen: ChosenPhotos, settings: MatchingSettings) -> ChosenPhotos:
    """Return the photos that are joined by people, with the people over all of them.

    Raises:
        InputError: no two photos share a person, or who is who is ambiguous in all pairs of photos.
    """
    while True:
        people = [photo.people for photo in chosen.photos]
        rows = join_tracks(people, chosen.matches, settings).rows
        chosen = replace(chosen, rows=rows, matches=joined_matches(people, chosen.matches, rows, settings))
        connected = _connected(chosen, settings)
        if len(connected.photos) == len(chosen.photos):
            return chosen
        chosen = connected


def _connected(chosen: ChosenPhotos, settings: MatchingSettings) -> ChosenPhotos:
    """Return the largest group of photos that pairs without ambiguity join.

    Raises:
        InputError: no two photos share a person, or who is who is ambiguous in all pairs of photos.
    """
    views = len(chosen.photos)
    group = list(range(views))
    shared = {pair: match for pair, match in chosen.matches.items() if match.pairs}
    for (a, b), match in shared.items():
        if match.margin >= settings.ambiguous:
            group = [group[a] if g == group[b] else g for g in group]
    score = {
        g: (sum(m.score for (a, b), m in chosen.matches.items() if group[a] == group[b] == g), group.count(g))
        for g in set(group)
    }
    best = max(score, key=lambda g: (score[g][1] > 1, *score[g]))
    if group.count(best) < 2:
        names = [photo.name for photo in chosen.photos]
        raise _ambiguous(names, chosen.left_out) if shared else _no_common_person(names, chosen.left_out)
    for view in reversed([v for v in range(views) if group[v] != best]):
        if any(view in (a, b) and best in (group[a], group[b]) for a, b in shared):
            chosen = chosen.without(view, "ambiguous", f"who is who in it is not clear; {_CLEARER}")
        else:
            chosen = chosen.without(view, "other people", "it shares no person with the other photos, in this pose")
    return chosen


def _ambiguous(names: Sequence[str], left: Sequence[LeftOut]) -> InputError:
    others = "".join(f"; {one.message}" for one in left)
    return InputError(
        f"who is who in these photos is not clear, as their people look alike ({', '.join(names)}){others}: {_CLEARER}"
    )


def _no_common_person(names: Sequence[str], left: Sequence[LeftOut]) -> InputError:
    others = "".join(f"; {one.message}" for one in left)
    return InputError(
        f"no two of the photos show the same person in the same pose ({', '.join(names)}){others}: give photos that "
        "were taken at the same moment, or of people who hold still, and that have at least one person in common"
    )


def _left_out(index: int, name: str, reason: str, why: str) -> LeftOut:
    return LeftOut(name, index, reason, f"{name} is skipped: {why}")
