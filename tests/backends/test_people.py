"""Overlap of boxes and of poses."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.backends.people import box_iou, keypoint_similarity


def test_iou_of_known_boxes():
    one = np.array([[0.0, 0, 10, 10]])
    others = np.array(
        [[0.0, 0, 10, 10], [5, 0, 15, 10], [10, 0, 20, 10], [3, 3, 3, 3], [-5, -5, 15, 15]]
    )
    assert box_iou(one, others)[0] == pytest.approx([1, 1 / 3, 0, 0, 1 / 4])


def test_a_pose_moved_by_the_errors_of_annotators_has_the_similarity_of_coco():
    """One joint is moved by two standard deviations, which leaves exp(-.5) of its share."""
    names = ("left_hip", "right_hip", "left_ankle", "right_ankle", "left_index1")
    pose = np.array([[0.0, 0], [100, 0], [0, 100], [100, 100], [50, 50]])
    moved = pose + np.array([[0, 0], [0, 0], [0, -2 * 0.089 * 100], [0, 0], [500, 0]])
    points = np.stack([pose, moved, pose + 500])
    sure = np.ones((3, 5))
    hidden = np.array([[1.0, 1, 0, 1, 1], [1, 1, 1, 1, 1], [0, 0, 0, 0, 0]])
    found = keypoint_similarity(points, sure, names)
    assert found[0, 1] == pytest.approx((3 + np.exp(-0.5)) / 4)
    assert found[0, 2] < 1e-6
    np.testing.assert_allclose(found, found.T)
    np.testing.assert_allclose(np.diag(found), 1)
    half = keypoint_similarity(points, hidden, names)
    assert half[0, 1] == pytest.approx(1)
    assert half[2].tolist() == [0, 0, 0]
