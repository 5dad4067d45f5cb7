"""Keypoints that the user gives in place of detected ones."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linear_sum_assignment

from physic_core.errors import InputError
from physic_core.types.skeletons import SURE_CONFIDENCE, keypoint_in_words, mirrored_order

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from physic_core.io.keypoint_file import GivenKeypoints
    from physic_core.types import BoolArray, FloatArray, Keypoints, People

_BEYOND = {
    "wrist": ("pinky", "index", "middle", "ring", "thumb", "hand"),
    "ankle": ("heel", "foot", "big_toe", "small_toe"),
}
"""Parts whose points move along with a corrected joint."""
_SAME_PX = 0.02
"""Distance of a given keypoint from the detected one up to which they are the same: a table of
keypoints is rounded.
"""
_FEWEST_EXCHANGED = 4  # given keypoints at the detected ones of the other side
_LEAST_EXCHANGED = 0.8  # share of them
_OUTSIDE = 0.01
"""Distance from the mask beyond which a joint lies outside of it, as a share of the box's
diagonal.
"""
_FAR_OUTSIDE = 0.2
"""The same beyond which the mask alone contradicts it.

Of 357 joints that people marked, two are as far outside.
"""
_LIMB = 0.25
"""Distance from the detected joint, in the same unit, beyond which it counts inside of the mask,
too.
"""


def corrected_keypoints(
    keypoints: Keypoints, given: GivenKeypoints, people: People
) -> tuple[Keypoints, BoolArray, tuple[str, ...]]:
    """Replace detected keypoints of N people by given ones, of the least error and no 3D point.

    Their confidence is the given one, or 1. Joints of another program's skeleton that the detector
    lacks are left out. A hand moves with its wrist and a foot with its ankle, unless their points
    are given too. A given point that lies where the detector found it changes nothing, so that a
    whole table of keypoints can be edited and given.

    Returns:
        The keypoints, which of them (N, J) the user changed, and notes.

    Raises:
        InputError: a given keypoint is of no person or joint of the result, or no annotation is of
            a person.
    """
    names = keypoints.joint_set.names
    given, missing = _without_unknown_joints(given, names)
    columns = [_keypoint_column(joint, names) for joint in given.joint]
    rows, strangers = _match_people(given, people)
    points = np.array(keypoints.points)
    confidence = np.array(keypoints.confidence)
    world, sigma = (None if x is None else np.array(x) for x in (keypoints.world, keypoints.sigma))
    wanted, wanted_confidence, changed = _given_values(keypoints, given, columns, rows)
    for person, column in np.argwhere(changed):
        new_position = wanted[person, column]
        (side, _, joint) = names[column].partition("_")
        beyond = tuple(f"{side}_{part}" for part in _BEYOND.get(joint, ()))
        with_it = [
            j
            for j, name in enumerate(names)
            if beyond and name.startswith(beyond) and not changed[person, j]
        ]
        points[person, with_it] += new_position - points[person, column]
        points[person, column] = new_position
        confidence[person, column] = wanted_confidence[person, column]
        if sigma is not None:
            sigma[person, column] = sigma[person].min()
        if world is not None:
            world[person, [column, *with_it]] = np.nan
    corrected = replace(keypoints, points=points, confidence=confidence, world=world, sigma=sigma)
    what = _describe_changes(keypoints, corrected, changed, given.file_px_per_px)
    return corrected, changed, (*given.notes, *missing, what, *strangers)


def _given_values(
    keypoints: Keypoints, given: GivenKeypoints, columns: Sequence[int], rows: Mapping[int, int]
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return points (N, J, 2) and confidence (N, J) with the given ones, and which ones these
    change.
    """
    wanted = np.array(keypoints.points, np.float64)
    changed = np.zeros(keypoints.confidence.shape, bool)
    sure = np.ones(keypoints.confidence.shape)
    kept = [i for i, number in enumerate(given.person) if number in rows]
    at = [rows[given.person[i]] for i in kept], [columns[i] for i in kept]
    wanted[at] = given.points[kept]
    if given.confidence is not None:
        sure[at] = given.confidence[kept]
    apart = np.abs(wanted[at] - keypoints.points[at]).max(-1)
    changed[at] = (keypoints.confidence[at] == 0) | (apart > _SAME_PX)
    return wanted, sure, changed


def contradicted_keypoints(
    detected: Keypoints, corrected: Keypoints, changed: BoolArray, people: People
) -> FloatArray:
    """Return how far (N, J) mask and detector contradict the keypoints of N people that the user
    changed, px.

    Outside of the mask, it is the distance from the detected joint if that is confident, or from
    the same joint of the other side if that is nearer, since a detector may confuse them; the same
    inside of the mask for more than a limb. Far outside it is at least the distance from the mask.
    It is 0 for other keypoints.

    Args:
        detected: before they were corrected.
        corrected: with the user's.
        changed: (N, J), which of them the user changed.
        people: with their masks.
    """
    import cv2

    twins = mirrored_order(detected.joint_set.names)
    is_confident = detected.confidence >= SURE_CONFIDENCE
    distance_px = np.zeros(changed.shape)
    for person in np.flatnonzero(changed.any(1)).tolist():
        box = people.boxes[person]
        mask = people.masks[person]
        from_mask = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
        diagonal = math.hypot(box[2] - box[0], box[3] - box[1])
        for column in np.flatnonzero(changed[person]).tolist():
            given_position = corrected.points[person, column]
            pair = [column, twins[column]]
            x, y = (
                np.rint(given_position).astype(int).clip(0, np.array(mask.shape[::-1]) - 1).tolist()
            )
            apart = np.linalg.norm(detected.points[person, pair] - given_position, axis=-1)[
                is_confident[person, pair]
            ].min(initial=np.inf)
            beyond = float(from_mask[y, x])
            is_elsewhere = beyond > _OUTSIDE * diagonal or apart > _LIMB * diagonal
            by_detector = apart if is_confident[person, column] and is_elsewhere else 0.0
            distance_px[person, column] = max(
                by_detector, beyond if beyond > _FAR_OUTSIDE * diagonal else 0.0
            )
    return distance_px


def _describe_changes(
    before: Keypoints, after: Keypoints, changed: BoolArray, file_px_per_px: float
) -> str:
    """Return a note on how many keypoints the user changed (N, J), and on the one that moved
    farthest, px of the file.
    """
    if not changed.any():
        return "the given keypoints are those of the detector: they change nothing"
    distance_px = np.linalg.norm(after.points - before.points, axis=-1)
    moved = np.where(changed, distance_px, -1.0)
    twins = mirrored_order(before.joint_set.names)
    from_twin = np.linalg.norm(after.points - before.points[:, twins], axis=-1)
    has_twin = np.array(twins) != np.arange(len(twins))
    is_of_twin = (from_twin < distance_px / 2)[changed & has_twin]
    is_exchanged = is_of_twin.sum() >= _FEWEST_EXCHANGED and is_of_twin.mean() > _LEAST_EXCHANGED
    person, column = (int(i) for i in np.unravel_index(moved.argmax(), moved.shape))
    return (
        f"given keypoints: {changed.sum()}; the {keypoint_in_words(after.joint_set.names[column])} "
        f"of person {person} lies {moved.max() * file_px_per_px:.0f} px from the detected "
        f"one{', the others less' if changed.sum() > 1 else ''}"
        f"{'. Check their names: left and right seem to be exchanged' if is_exchanged else ''}"
    )


def _without_unknown_joints(
    given: GivenKeypoints, names: Sequence[str]
) -> tuple[GivenKeypoints, tuple[str, ...]]:
    """Return the keypoints of another program without joints that the detector lacks, and a note on
    them.

    Names that the user typed in CSV are not left out; :func:`_keypoint_column` refuses them.
    """
    known = np.array([joint in names or f"{joint}_surface" in names for joint in given.joint])
    if given.has_person_numbers or known.all() or not known.any():
        return given, ()
    known_rows = np.flatnonzero(known).tolist()
    chosen = replace(
        given,
        person=tuple(given.person[i] for i in known_rows),
        joint=tuple(given.joint[i] for i in known_rows),
        points=given.points[known],
        confidence=None if given.confidence is None else given.confidence[known],
    )
    return chosen, (
        f"left out {(~known).sum()} given keypoints of joints that the keypoint detector does not "
        f"have",
    )


def _keypoint_column(joint: str, names: Sequence[str]) -> int:
    """Return the index of a joint; names of COCO such as "left_eye" are those of the surface."""
    for name in (joint, f"{joint}_surface"):
        if name in names:
            return names.index(name)
    raise InputError(
        f"a given keypoint is named {joint!r}, which the keypoint detector does not have: use "
        f"{', '.join(names)}"
    )


def _match_people(given: GivenKeypoints, people: People) -> tuple[dict[int, int], tuple[str, ...]]:
    """Return number in the file -> person, and notes about annotations without a person.

    Annotations and people are matched one to one: most points of an annotation lie in the person's
    box, and of several people the mask decides.
    """
    count = len(people)
    numbers = sorted(set(given.person))
    if given.has_person_numbers:
        if wrong := [number for number in numbers if not 0 <= number < count]:
            raise InputError(
                f"keypoints are given for person {wrong[0]}, and {count} people were found: number "
                "them from 0, as in people.csv"
            )
        return {number: number for number in numbers}, ()
    in_box, in_mask = np.zeros((2, len(numbers), count))
    height, width = people.masks.shape[1:]
    x0, y0, x1, y1 = np.asarray(people.boxes, np.float64).reshape(-1, 4).T
    for row, number in enumerate(numbers):
        points = given.points[np.array(given.person) == number]
        x, y = points.T[..., None]
        in_box[row] = ((x0 - 0.5 <= x) & (x < x1 - 0.5) & (y0 - 0.5 <= y) & (y < y1 - 0.5)).mean(0)
        columns, lines = np.rint(points).astype(int).clip(0, np.array([width, height]) - 1).T
        in_mask[row] = people.masks[:, lines, columns].mean(1)
    allowed = in_box > 0.5
    # A pair that is not allowed costs more than any that is.
    pairs = zip(*linear_sum_assignment(np.where(allowed, -(in_box + in_mask), 1.0)), strict=True)
    rows = {numbers[row]: int(person) for row, person in pairs if allowed[row, person]}
    if not rows:
        raise InputError(
            f"the given keypoints match none of the {count} people who were found: "
            "most points of an annotation should lie in the box of its person; are they "
            "px of another picture?"
        )
    unmatched = [str(number) for number in numbers if number not in rows]
    note = (
        f"left out the given keypoints of annotation {', '.join(unmatched)} (counted from 0): no "
        f"person was found there"
    )
    return rows, (note,) if unmatched else ()
