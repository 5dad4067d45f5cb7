"""Photos that are mirrored: people and background are compared with those of the mirror image."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import JOINT_NAMES
from physic_scene.bundle import Bundle, BundleSettings, Observations, adjust, energy
from physic_scene.cameras import reference_photo, start_poses
from physic_scene.matching import MatchingSettings, PairMatch, joined_matches

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_scene.observations import PhotoPeople
    from physic_scene.selection import ChosenPhotos, Photo

__all__ = ["mirrored_by_adjustment", "mirrored_by_matches", "mirrored_photo"]


def mirrored_by_matches(
    views: int,
    matches: dict[tuple[int, int], PairMatch],
    mirrors: dict[tuple[int, int], PairMatch],
    settings: MatchingSettings,
) -> tuple[int, ...]:
    """Return the photos, less than half or the later of two, that are likeliest mirrored against the others.

    Args:
        views: number of photos.
        matches: of each pair of photos a < b.
        mirrors: the same with the mirror image of the second.
        settings: of the matching.
    """

    def gain(chosen: tuple[int, ...]) -> float:
        apart = [pair for pair in matches if (pair[0] in chosen) != (pair[1] in chosen)]
        return sum(_evidence(mirrors[pair]) - _evidence(matches[pair]) for pair in apart)

    subsets = (
        tuple(sorted(chosen))
        for count in range(views // 2 + 1)
        for chosen in itertools.combinations(reversed(range(views)), count)
    )
    return max(subsets, key=lambda chosen: gain(chosen) - settings.mirrored * len(chosen))


def mirrored_by_adjustment(chosen: ChosenPhotos, matching: MatchingSettings, settings: BundleSettings) -> int | None:
    """Return the photo whose mirror image fits the other photos best, None without clear evidence for it.

    Cameras and points of all photos are adjusted with each photo, and with its mirror image. Half the difference of
    energy is the logarithm of the ratio of likelihoods, which must exceed the prior odds that a photo is not mirrored.
    Of two photos, the later one counts.

    Args:
        chosen: photos, with the people over all of them.
        matching: settings with the prior odds.
        settings: of the adjustment.
    """
    views = range(len(chosen.photos)) if len(chosen.photos) > 2 else (1,)
    as_given = _energy(chosen, settings)
    llr = {v: (as_given - _energy(_with_mirror_image(chosen, v, matching), settings)) / 2 for v in views}
    likeliest = max(llr, key=lambda view: llr[view])
    return likeliest if llr[likeliest] > matching.mirrored else None


def mirrored_photo(photo: Photo) -> Photo:
    """Return the mirror image of a photo, as far as matching and adjustment use it."""
    return replace(photo, people=_mirrored_people(photo.people, photo.result.intrinsics.width))


def _evidence(match: PairMatch) -> float:
    """Return the score of two photos' people and background, or that of their background alone."""
    by_background = 0.0 if match.background is None else max(match.background.llr, 0.0)
    return match.score if match.pairs else by_background


def _energy(chosen: ChosenPhotos, settings: BundleSettings) -> float:
    """Return the least energy of cameras and points by people and floors alone."""
    reference = reference_photo(chosen.rows)
    observations = Observations.of([photo.people for photo in chosen.photos], chosen.rows)
    start = Bundle.start(observations, start_poses(chosen, reference))
    return energy(observations, adjust(observations, start, reference, settings), reference, settings)


def _with_mirror_image(chosen: ChosenPhotos, view: int, settings: MatchingSettings) -> ChosenPhotos:
    """Return the photos with the mirror image of one of them, and the motions between the cameras that follow."""
    photos = tuple(mirrored_photo(photo) if v == view else photo for v, photo in enumerate(chosen.photos))
    matches = joined_matches([photo.people for photo in photos], chosen.matches, chosen.rows, settings)
    return replace(chosen, photos=photos, matches=matches)


def _mirrored_people(people: PhotoPeople, width: int) -> PhotoPeople:
    """Return the people of the mirror image of a photo with a width in px; their parameters stay."""
    joints, keypoints = _other_sides(JOINT_NAMES), _other_sides(people.skeleton.names)
    flip, K = np.array([-1.0, 1.0, 1.0]), people.K.copy()
    K[0, 2] = width - 1 - K[0, 2]
    return replace(
        people,
        K=K,
        points=people.points[:, keypoints] * flip[:2] + [width - 1, 0],
        confidence=people.confidence[:, keypoints],
        landmarks=people.landmarks[:, keypoints] * flip,
        joints=people.joints[:, joints] * flip,
        up=people.up * flip,
    )


def _other_sides(names: Sequence[str]) -> list[int]:
    """Return the index of the keypoint of the other side for each keypoint; the own one for those of the middle."""
    return [list(names).index(_other_side(name)) for name in names]


def _other_side(name: str) -> str:
    side, _, rest = name.partition("_")
    return {"left": f"right_{rest}", "right": f"left_{rest}"}.get(side, name)
