"""Bends of hips and knees of people whom a crop removes below the hips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from physic_core.types.skeletons import SIDES

from .regression import Array, Examples, fit_linear, left_out, logits_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Keypoints

    from .labels import Photo
    from .sample import Encoder, Picture, Seen

RIDGE = 300.0

_SURE = 0.5  # least confidence of the joints whose angles count
_LEAST_PX = 48  # of the picture above the cut, and of the person in it


@dataclass(frozen=True)
class Cut:
    """A person whose legs a crop removes.

    Attributes:
        person: row of the person.
        row: first row of the picture that is removed.
        bends: (2, 2) degrees of the hips and of the knees, left and right.
    """

    person: int
    row: int
    bends: Array


def cut_of(seen: Seen) -> Cut | None:
    """Return the cut of the tallest person of a picture all of whose legs are seen; None without
    one.
    """
    names = seen.keypoints.joint_set.names
    joints = [
        names.index(f"{side}_{j}") for side in SIDES for j in ("shoulder", "hip", "knee", "ankle")
    ]
    sure = (seen.keypoints.confidence[:, joints] >= _SURE).all(1)
    heights = np.where(sure, seen.boxes[:, 3] - seen.boxes[:, 1], 0)
    if not sure.any():
        return None
    i = int(heights.argmax())
    hips = [names.index(f"{side}_hip") for side in SIDES]
    row = round(float(seen.keypoints.points[i, hips, 1].mean()))
    if min(row, row - seen.boxes[i, 1]) < _LEAST_PX:
        return None
    return Cut(i, row, bends_of(seen.keypoints)[i])


def bends_of(keypoints: Keypoints) -> Array:
    """Return the bends (N, 2, 2) of hips and knees, left and right, degrees; 0 is straight."""
    names = keypoints.joint_set.names
    assert keypoints.world is not None
    world = keypoints.world.astype(np.float64)

    def bend(*joints: str) -> Array:
        a, b, c = (world[:, names.index(joint)] for joint in joints)
        first, second = b - a, c - b
        length = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
        cosine = (first * second).sum(1) / np.maximum(length, 1e-9)
        angle: Array = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        return angle

    chains = (("shoulder", "hip", "knee"), ("hip", "knee", "ankle"))
    return np.stack(
        [
            np.stack([bend(*(f"{side}_{joint}" for joint in chain)) for side in SIDES], 1)
            for chain in chains
        ],
        1,
    )


def see_cut(picture: Picture, seen: Seen, cut: Cut, encoder: Encoder) -> Array:
    """Return the mean token (C,) of what a crop leaves of a person."""
    box = seen.boxes[cut.person : cut.person + 1].copy()
    box[:, 3] = cut.row
    found: Array = encoder(np.ascontiguousarray(picture[: cut.row])).within(box)[0]
    return found


@dataclass(frozen=True)
class CutPerson:
    """What a crop leaves of a person, and how the legs are bent.

    Attributes:
        photo: of the person.
        token: (C,) mean of the box above the cut.
        bends: (2, 2) degrees of the hips and of the knees, left and right.
    """

    photo: Photo
    token: Array
    bends: Array


def fit_bends(
    people: Sequence[CutPerson], ridge: float = RIDGE
) -> tuple[NDArray[np.float32], list[str]]:
    """Return the numbers of "flexion" (2, C + 2), and lines of the mean errors in degrees.

    The standard deviation is that of people whose repository was left out, each side apart: both
    sides get the same answer.
    """
    fit = partial(fit_linear, ridge=ridge)
    first = [one for one in people if one.photo.set == "given"]
    other = [one for one in people if one.photo.set != "given"]
    of = _examples(people, by_repository=True)
    off = left_out(of, fit)[:, :, None] - np.array([one.bends for one in people])
    sigma = np.sqrt((off**2).mean((0, 2)))
    numbers = np.column_stack([fit(of), sigma]).astype(np.float32)
    given = _examples(first)
    found = {
        "photos left out": (left_out(given, fit), first),
        "repositories left out": (left_out(_examples(first, by_repository=True), fit), first),
    }
    if other:
        found["other"] = logits_of(fit(given), _examples(other).x), other
    mean = given.y.mean(0)
    lines = []
    for part, (answers, who) in found.items():
        truth = np.array([one.bends for one in who])
        errors = np.abs(answers[:, :, None] - truth).mean((0, 2))
        constant = np.abs(mean[None, :, None] - truth).mean((0, 2))
        lines.append(
            f"flexion  {part:22} {len(who)}: hip {errors[0]:.1f}, knee {errors[1]:.1f} degrees; "
            f"a constant {constant[0]:.1f}, {constant[1]:.1f}"
        )
    return numbers, lines


def _examples(people: Sequence[CutPerson], *, by_repository: bool = False) -> Examples:
    return Examples(
        np.array([one.token for one in people]),
        np.array([one.bends.mean(1) for one in people]),
        np.ones(len(people)),
        [one.photo.repository if by_repository else one.photo.group for one in people],
    )
