"""Boxes of hands from keypoints."""

from __future__ import annotations

import numpy as np

from physic_core.types import Keypoints, Skeleton
from physic_human.hands import hand_boxes


def keypoints(skeleton: Skeleton | str, count: int, people: int = 1) -> Keypoints:
    return Keypoints(np.zeros((people, count, 2)), np.zeros((people, count)), skeleton)


def test_the_21_points_of_a_hand_give_its_box() -> None:
    given = keypoints("coco_wholebody133", 133)
    given.points[0, 91:112] = np.random.default_rng(0).uniform([50, 80], [90, 140], (21, 2))
    given.points[0, 91], given.points[0, 92] = [50, 80], [90, 140]
    given.confidence[0, 91:112] = 0.8
    found = hand_boxes(given)
    np.testing.assert_allclose(found.boxes, [[50.5, 80.5, 90.5, 140.5]])  # half open: counted from edges of pixels
    np.testing.assert_allclose(found.confidence, [0.8])
    assert found.right.tolist() == [False]
    assert not len(hand_boxes(given, least_confidence=0.9))


def test_all_confidences_of_a_hand_count_in_its_mean() -> None:
    """As in the code of the PhySIC paper, which lowers no confidence before it chooses hands."""
    given = keypoints("coco_wholebody133", 133)
    given.points[0, 91:112] = np.linspace([50, 80], [90, 140], 21)
    given.confidence[0, 91:112] = [0.95] * 15 + [0.3] * 6  # without those below 0.5 the mean is 0.68
    np.testing.assert_allclose(hand_boxes(given, least_confidence=0.7).confidence, [0.764], atol=1e-3)


def test_left_is_the_persons_left() -> None:
    given = keypoints("coco_wholebody133", 133, people=2)
    given.points[1, 112:133] = np.linspace([0, 0], [30, 40], 21)
    given.confidence[1, 112:133] = 0.9
    found = hand_boxes(given)
    assert found.person.tolist() == [1]
    assert found.right.tolist() == [True]


def test_a_hand_is_beyond_the_wrist_where_only_arms_are_known() -> None:
    for skeleton, count, arm in (("coco17", 17, (6, 8, 10)), ("blazepose33", 33, (12, 14, 16))):
        given = keypoints(skeleton, count)
        given.points[0, list(arm)] = [[0, 0], [100, 0], [200, 0]]
        given.confidence[0, list(arm)] = [1.0, 0.7, 0.9]
        found = hand_boxes(given)
        assert found.right.tolist() == [True]
        np.testing.assert_allclose(found.boxes[0], [233.5 - 37.5, 0.5 - 37.5, 233.5 + 37.5, 0.5 + 37.5])
        np.testing.assert_allclose(found.confidence, [0.7])


def test_a_forearm_towards_the_camera_does_not_make_a_small_hand() -> None:
    given = keypoints("coco17", 17)
    given.points[0, [5, 7, 9]] = [[0, 0], [0, 100], [0, 110]]
    given.confidence[0, [5, 7, 9]] = 1.0
    box = hand_boxes(given).boxes[0]
    np.testing.assert_allclose(box[2] - box[0], 0.75 * 90)
