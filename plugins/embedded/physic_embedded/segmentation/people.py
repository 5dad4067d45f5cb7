"""Detect the poses of all people in an image.

YOLOX detects people as boxes. The landmark network, which expects one person, runs on each box.
Unless all boxes and their poses are sure, BlazePose's own detector adds people that YOLOX misses.
It also looks into the square around each box that is not sure, for a second start of the landmark
network there. Both also detect animals and boards as people: boxes that YOLOX scores higher as one
of these are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import compress
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from physic_core.backends.people import SAME_PERSON, box_iou, keypoint_similarity
from physic_core.types import FOUND_TWICE, HARDLY_VISIBLE, UnposedPerson, skeleton_named
from physic_embedded.networks.crops import ImagePyramid
from physic_embedded.networks.pose import (
    average_agreeing,
    person_square,
    predict_pose,
    predict_pose_above_score,
    predict_pose_if_present,
)
from physic_embedded.networks.pose_detection import detect_people
from physic_embedded.networks.yolox import detect_boxes
from physic_embedded.segmentation.hidden_people import grey_out, without_covered_joints
from physic_embedded.segmentation.rotated_people import (
    SURE_FIT,
    best_pose_of_turned_squares,
    is_rotated_pose,
    is_stable_pose,
    square_around,
)
from physic_embedded.segmentation.upper_bodies import square_from_upper_half, with_upper_bodies

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from physic_core.types import Carrier, FloatArray, UInt8Array
    from physic_embedded.networks.crops import RotatedSquare
    from physic_embedded.networks.pose import Pose
    from physic_embedded.networks.yolox import BoxesByClass
    from physic_networks.onnx_sessions import OnnxSession
    from physic_networks.people import Detections


BOX_TILES = (0.5,)
"""Sides of the tiles for YOLOX, over the image's long side."""
WEAK_MARGIN = 0.1
"""Boxes with a score lower by up to this than ``box_score`` are tried, and kept if a pose fits them
well.
"""
LEAST_HEIGHT_PX = 40.0
"""Least height of the mask of a person; lower people are omitted."""
LOW = f"lower than {LEAST_HEIGHT_PX:g} px"
_LEAST_BOX_SHARE = 0.75
"""Least height of a box that is looked at, over that of a mask. In 314 photos no lower box becomes
a mask that is tall enough.
"""
LEAST_SCORE = 0.2
"""Score from which on a box without a pose is reported: somebody may be there."""
LEAST_FIT = 0.15
"""A pose with a lower fit to its box or mask belongs to another person or to nothing."""
MIN_WEAK_FIT = 0.3
"""The same for a box with a weak score."""
CUT_FROM = 0.99
"""Share of the photo's height, below which the lower edge of a box cuts a person off."""
SAME_THING = 0.7
"""Least intersection over union at which a box of a person and one of an animal or a board show the
same object.
"""
MIN_MASK_FIT = 0.45
"""Least intersection over union of a box and the mask of an upper half."""
MAX_MIRROR_GAP = 0.025
"""Largest difference of the poses of an upper half and of its mirror image, over the square's
side.
"""
MIN_PART = 0.8
"""Least share of a box in that of the person of whom it shows a part. On 65 photos of people close
together, boxes of somebody else in whom the network finds that person's pose have .79 or less.
"""
MAX_SHARED_MASK = 0.5
"""A pose without a box, or found with others in grey, whose mask shares more than this with another
person's, over the smaller of both, is of that person.
"""
SAME_MASK = 0.95
"""The same limit for an unsteady pose in a box: set by one photo, of a pose of two people. A limit
of .5 loses 2 real people of 193.
"""
UNSTEADY = 0.05
"""Mirror gap from which a pose is unsteady: in a box around a part of a person, or around two
people, the network mixes them up.
"""
SIMILAR_FIT = 0.7
"""Poses with this share of the best fit are compared by their mirror images."""
NEAR_HIPS = 0.14
"""Largest distance of the hips of one person in two squares, over the larger side."""
SAME_PLACE = 0.02
"""Joints of two poses that are nearer than this share of the square's side are averaged."""


SURE_SCORE = 0.75
"""BlazePose score from which a candidate is a person, see :func:`is_person`."""
WEAK_SCORE = 0.3
"""BlazePose score from which a candidate is tried; 0.2 more in a tile."""


@dataclass(frozen=True)
class DetectedPose:
    """Pose of one person, with the score and the box of the detection.

    Attributes:
        pose: of the landmark network.
        score: in [0, 1].
        box: (4,) x0 y0 x1 y1 px of YOLOX, or None if only BlazePose detected the person.
    """

    pose: Pose
    score: float
    box: FloatArray | None = None

    @property
    def extent(self) -> FloatArray:
        """The box (4,), else that of the mask of the pose."""
        return self.pose.mask_box if self.box is None else self.box


def unposed_person(box: FloatArray, score: float, reason: str) -> UnposedPerson:
    """Return a person in a box (4,) x0 y0 x1 y1 px, without a pose."""
    x0, y0, x1, y1 = (float(edge) for edge in box)
    return UnposedPerson((x0, y0, x1, y1), score, reason)


class FoundPeople(NamedTuple):
    """People in an image.

    Attributes:
        posed: people with a pose, best first.
        unposed: boxes of people without a pose, and of people with one who were found twice.
        not_people: name of the animal or the board in each box that was left out.
        carriers: what may carry a person.
    """

    posed: list[DetectedPose]
    unposed: list[UnposedPerson]
    not_people: list[str]
    carriers: tuple[Carrier, ...]


def detect_poses(
    box_detector: OnnxSession,
    pose_detector: OnnxSession,
    landmarker: OnnxSession,
    image: UInt8Array,
    *,
    box_score: float,
    fractions: tuple[float, ...],
    max_people: int,
) -> FoundPeople:
    """Detect the people in an image (H, W, 3).

    Args:
        box_detector: session of ``yolox_nano``.
        pose_detector: session of ``pose_detection``.
        landmarker: session of ``pose_landmark_heavy``.
        image: RGB.
        box_score: lowest score of a YOLOX box in the full image, and of what carries people.
        fractions: sides of the tiles over the image's long side, for BlazePose; empty to search the
            full image only.
        max_people: number of people that are kept.
    """
    picture = ImagePyramid.from_image(image)
    lowest = max(box_score - WEAK_MARGIN, 0.0)
    least = min(lowest, LEAST_SCORE)
    tiles = BOX_TILES if fractions else ()
    things = detect_boxes(
        box_detector, image, min_score=least, min_tile_score=least, fractions=tiles
    )
    every, left_out = _without_things(things, box_score)
    is_tall = every.boxes[:, 3] - every.boxes[:, 1] >= _LEAST_BOX_SHARE * LEAST_HEIGHT_PX
    boxes = every[is_tall & (every.scores > lowest)]
    posed = [
        (box, float(score), pose_in_box(landmarker, picture, box))
        for box, score in zip(boxes.boxes, boxes.scores, strict=True)
    ]
    is_sure = [_is_sure(box, score, pose, box_score) for box, score, pose in posed]
    # The second search costs as much as all the rest, and adds no people where all boxes are sure.
    blazepose = []
    if not posed or not all(is_sure):
        blazepose = _search_blazepose(
            pose_detector,
            landmarker,
            picture,
            fractions,
            posed,
            is_sure,
            max_candidates=2 * max_people,
        )
    others = [pose for pose, _ in blazepose]
    candidates = [
        [] if one_is_sure else [*others, *_upper_half(landmarker, picture, box)]
        for one_is_sure, (box, _, _) in zip(is_sure, posed, strict=True)
    ]
    without_box = _poses_without_box(blazepose, things, lowest)
    people = _without_repeats(_best_poses(posed, candidates, box_score) + without_box)
    unposed = _add_hidden_people(landmarker, image, posed, people, box_score)
    unposed += _beyond_limit(people, max_people)
    unposed += _people_without_look(every[~is_tall | (every.scores <= lowest)], box_score)
    people = _with_upper_bodies(landmarker, image, people[:max_people])
    return FoundPeople(people, unposed, left_out, things.carriers(box_score))


def _poses_without_box(
    poses: Sequence[tuple[Pose, float]], things: BoxesByClass, least: float
) -> list[DetectedPose]:
    """Return the sure ones of poses with scores, where no animal or board of ``least`` score is."""
    return [
        DetectedPose(pose, 0.5 * score * pose.score)
        for pose, score in poses
        if is_person(pose, score, SURE_SCORE)
        and not things.other_at(pose.mask_box, least, SAME_THING)
    ]


def _beyond_limit(people: Sequence[DetectedPose], max_people: int) -> list[UnposedPerson]:
    """Return the people who are more than the limit."""
    why = f"more than {max_people} people: raise it with --set segmenter.options.max_people=N"
    return [unposed_person(person.extent, person.score, why) for person in people[max_people:]]


def _people_without_look(boxes: Detections, box_score: float) -> list[UnposedPerson]:
    """Return the people of boxes that are too low, or whose scores are too low, to look at them."""
    return [
        unposed_person(box, float(score), LOW if score >= box_score else HARDLY_VISIBLE)
        for box, score in zip(boxes.boxes, boxes.scores, strict=True)
    ]


def _with_upper_bodies(
    landmarker: OnnxSession, image: UInt8Array, people: Sequence[DetectedPose]
) -> list[DetectedPose]:
    """Return the people, those of whom only the upper part is visible with another pose."""
    poses = with_upper_bodies(landmarker, image, [person.pose for person in people])
    return [replace(person, pose=pose) for person, pose in zip(people, poses, strict=True)]


def _without_repeats(detections: list[DetectedPose]) -> list[DetectedPose]:
    """Return the best pose of each person, best first."""
    kept: list[DetectedPose] = []
    for person in sorted(detections, key=lambda person: -person.score):
        most_shared = MAX_SHARED_MASK
        if person.box is not None:
            most_shared = SAME_MASK if person.pose.mirror_gap > UNSTEADY else 1.0
        if _is_new(person.pose, kept, most_shared) and not _repeats_turned_person(person, kept):
            kept.append(person)
    return kept


def _repeats_turned_person(person: DetectedPose, people: Sequence[DetectedPose]) -> bool:
    """Return whether a pose is in a part of the box of somebody who is not upright, and shares the
    mask: there the network finds another pose of this person.
    """
    return any(
        person.box is not None
        and other.box is not None
        and is_rotated_pose(other.pose, box_fit(other.pose, other.box))
        and share_inside(person.box, other.box) >= MIN_PART
        and mask_overlap(person.pose, other.pose) > MAX_SHARED_MASK
        for other in people
    )


def _is_new(pose: Pose, people: Sequence[DetectedPose], most_shared: float) -> bool:
    """Return whether a pose is of none of other people, and its mask shares at most this with each
    of theirs, over the smaller of both.
    """
    return not poses_of_same_person(pose, people) and all(
        mask_overlap(pose, other.pose) <= most_shared for other in people
    )


def _without_things(things: BoxesByClass, box_score: float) -> tuple[Detections, list[str]]:
    """Return the boxes of people that no better box of an animal or a board covers, and the names
    at the others.

    Names at boxes of weak score are omitted, since these boxes might not have become people.
    """
    people = things.people
    others = [
        things.other_at(box, float(score), SAME_THING)
        for box, score in zip(people.boxes, people.scores, strict=True)
    ]
    left_out = filter(None, compress(others, people.scores >= box_score))
    return people[[name is None for name in others]], list(left_out)


def _add_hidden_people(
    landmarker: OnnxSession,
    image: UInt8Array,
    posed: Sequence[tuple[FloatArray, float, Pose]],
    kept: list[DetectedPose],
    box_score: float,
) -> list[UnposedPerson]:
    """Add to ``kept`` the people of boxes that gave no pose of their own, with the others in grey.

    Returns:
        The boxes that still have no pose. Those around a part of somebody, whose pose the landmark
        network finds from there, are found twice; those of weak score are hardly visible.
    """
    unposed = []
    grey: list[Pose] = []  # people in grey in ``picture``
    picture = ImagePyramid.from_image(image)
    for box, score, own in posed:
        if any(person.box is not None and np.array_equal(person.box, box) for person in kept):
            continue
        if _repeats_turned_person(DetectedPose(own, score, box), kept) or _is_part_of_person(
            box, own, kept
        ):
            unposed.append(unposed_person(box, score, FOUND_TWICE))
            continue
        if len(grey) != len(kept):
            grey = [person.pose for person in kept]
            picture = ImagePyramid.from_image(grey_out(image, grey))
        least = LEAST_FIT if score >= box_score else MIN_WEAK_FIT
        for pose in _poses_of_hidden_person(landmarker, picture, box, least):
            fit = float(score * pose.score * np.sqrt(box_fit(pose, box)))
            person = DetectedPose(without_covered_joints(pose, grey), fit, box)
            if _is_new(pose, kept, MAX_SHARED_MASK):
                kept.append(person)
                break
        else:
            why = "no pose fits the box" if score >= box_score else HARDLY_VISIBLE
            unposed.append(unposed_person(box, score, why))
    return unposed


def _is_part_of_person(box: FloatArray, pose: Pose, people: Sequence[DetectedPose]) -> bool:
    """Return whether a box (4,) is around a part of somebody: the pose in it is theirs, and it lies
    in their box. The pose in a box beyond theirs may be of the wrong one of two people.
    """
    same = poses_of_same_person(pose, people)
    return any(share_inside(box, one.extent) >= MIN_PART for one in same)


def share_inside(box: FloatArray, other: FloatArray) -> float:
    """Return the share of a box (4,) that lies inside another one."""
    side = np.minimum(box[2:], other[2:]) - np.maximum(box[:2], other[:2])
    return float(np.maximum(side, 0.0).prod() / (box[2:] - box[:2]).prod())


def _poses_of_hidden_person(
    landmarker: OnnxSession, picture: ImagePyramid, box: FloatArray, min_fit: float
) -> Iterator[Pose]:
    """Yield poses that fit a box (4,), of a whole person or of a person of whom only the upper half
    is visible.

    The squares are not refined: that would move them to a neighbour. The mask of the upper half
    fits the box, the joints do not, and chairs look like one: its pose must be the same in the
    mirror image.
    """
    whole = predict_pose_above_score(landmarker, picture, square_around(box), 0.5)
    if whole is not None and box_fit(whole, box) > min_fit:
        yield whole
    upper = predict_pose_above_score(landmarker, picture, square_from_upper_half(box), 0.95)
    if (
        upper is not None
        and upper.mirror_gap < MAX_MIRROR_GAP
        and _iou(upper.mask_box, box) > MIN_MASK_FIT
    ):
        yield upper


def _upper_half(landmarker: OnnxSession, picture: ImagePyramid, box: FloatArray) -> list[Pose]:
    """Return the pose of a person whom the lower edge of the photo may cut off.

    In the square of a whole body, the landmark network squeezes hips into the chest.
    """
    if box[3] < CUT_FROM * picture.height:
        return []
    pose = predict_pose_if_present(landmarker, picture, square_from_upper_half(box))
    return [] if pose is None else [pose]


def _is_sure(box: FloatArray, score: float, pose: Pose, box_score: float) -> bool:
    """Return whether a pose fits a box: one that is the same in the mirror image, in a box with a
    high score, or the clear pose of somebody who is not upright. A box around a part of somebody
    fits less.
    """
    fit = box_fit(pose, box)
    turned = is_rotated_pose(pose, fit) and fit >= SURE_FIT
    return turned or (score >= box_score and is_stable_pose(pose, fit))


def _search_blazepose(
    pose_detector: OnnxSession,
    landmarker: OnnxSession,
    picture: ImagePyramid,
    fractions: tuple[float, ...],
    posed: Sequence[tuple[FloatArray, float, Pose]],
    is_sure: Sequence[bool],
    max_candidates: int,
) -> list[tuple[Pose, float]]:
    """Return the poses of BlazePose's own detector, also around boxes that are not sure, with its
    scores, but those at the hips of people who are sure.
    """
    known = [pose for _, _, pose in compress(posed, is_sure)]
    around = [box for box, _, _ in compress(posed, [not one for one in is_sure])]
    candidates = detect_people(
        pose_detector, picture, WEAK_SCORE, WEAK_SCORE + 0.2, fractions, around
    )
    poses_and_fits = []
    for d in candidates[:max_candidates]:
        square = person_square(d.keypoints[0], d.keypoints[1])
        if any(_is_at_hips(square, one.square) for one in known):
            continue
        pose = predict_pose_if_present(landmarker, picture, square)
        if pose is not None:
            poses_and_fits.append((pose, d.score))
    return poses_and_fits


def _is_at_hips(square: RotatedSquare, other: RotatedSquare) -> bool:
    """Return whether two squares are around the same hips."""
    apart = float(np.linalg.norm(square.center - other.center))
    return apart <= NEAR_HIPS * max(square.side, other.side)


def _best_poses(
    posed: Sequence[tuple[FloatArray, float, Pose]],
    others: Sequence[Sequence[Pose]],
    box_score: float,
) -> list[DetectedPose]:
    """Return the best pose for each box, from the box's own pose and from its ``others``.

    A box below ``box_score`` needs a better fit.
    """
    best_poses = []
    for (box, score, box_pose), candidates in zip(posed, others, strict=True):
        poses = [box_pose, *(pose for pose in candidates if _iou(pose.joints_box, box) > 0.4)]
        fits = np.array([box_fit(pose, box) for pose in poses])
        similar = list(compress(poses, fits >= SIMILAR_FIT * fits.max()))
        best = min(similar, key=lambda pose: pose.mirror_gap - 0.05 * pose.score)
        best = average_agreeing(best, similar, SAME_PLACE)
        least = LEAST_FIT if score >= box_score else MIN_WEAK_FIT
        if best.score > 0.5 and fits.max() > least:
            best_poses.append(
                DetectedPose(best, float(score * best.score * np.sqrt(fits.max())), box)
            )
    return best_poses


def pose_in_box(landmarker: OnnxSession, picture: ImagePyramid, box: FloatArray) -> Pose:
    """Return the pose of the person in a box (4,), who need not be upright."""
    pose = predict_pose(landmarker, picture, square_around(box))
    return best_pose_of_turned_squares(
        landmarker, picture, box, pose, lambda one: box_fit(one, box)
    )


def box_fit(pose: Pose, box: FloatArray) -> float:
    """Return how well a pose fits a box (4,): the product of two intersections over union, in [0,
    1].

    They compare the box with the bounding box of the joints and with that of the pose's own mask.
    """
    return _iou(pose.joints_box, box) * _iou(pose.mask_box, box)


_CELLS = 96


def mask_overlap(a: Pose, b: Pose) -> float:
    """Return the intersection of the masks of two poses over the smaller of them, on a grid of
    96 cells a side.
    """
    both = np.stack([a.mask_box, b.mask_box])
    low = both[:, :2].min(axis=0)
    high = both[:, 2:].max(axis=0)
    step = max(float((high - low).max()) / _CELLS, 1.0)
    x, y = (np.arange(low[i], high[i], step) for i in (0, 1))
    first = a.mask_on_grid(x, y) > 0
    second = b.mask_on_grid(x, y) > 0
    return float((first & second).sum() / max(min(first.sum(), second.sum()), 1))


def _iou(a: FloatArray, b: FloatArray) -> float:
    return float(box_iou(a[None], b[None])[0, 0])


def is_person(pose: Pose, detected: float, sure: float) -> bool:
    """Return whether a candidate is a person.

    From a detector score of ``sure`` on, the landmark network's score decides. By itself, that
    score also accepts armchairs. A weaker candidate must therefore look the same in the mirror
    image, and have a trunk of plausible length.

    Args:
        pose: output of the landmark network for it.
        detected: the detector's score.
        sure: such as 0.75.
    """
    if detected >= sure:
        return pose.score > 0.5
    steady = pose.mirror_gap < 0.015 and pose.mirror_mask_iou > 0.92
    return pose.score > 0.95 and steady and pose.torso_length > 0.15 * pose.square.side


def poses_of_same_person(pose: Pose, people: Sequence[DetectedPose]) -> list[DetectedPose]:
    """Return those of other people whose pose is of the same person."""
    poses = [pose, *(person.pose for person in people)]
    similar = keypoint_similarity(
        np.stack([one.points for one in poses]),
        np.stack([one.visibility * one.presence for one in poses]),
        skeleton_named("blazepose33").names,
    )[0, 1:]
    return list(compress(people, similar > SAME_PERSON))
