"""``benchmarks/blazepose`` on landmarks that are moved by hand."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.blazepose import placed

K = np.array([[1000.0, 0, 500], [0, 1000, 400], [0, 0, 1]])


@pytest.mark.parametrize("unseen", [0, 10, 33])
def test_landmarks_that_project_onto_their_keypoints_are_placed_where_they_are(unseen):
    rng = np.random.default_rng(unseen)
    truth = rng.normal([0.3, -0.2, 4.0], 0.4, (33, 3))
    points = truth @ K.T
    points = points[:, :2] / points[:, 2:]
    confidence = np.ones(33)
    confidence[:unseen] = 0
    if unseen < len(truth):
        points[:unseen] += 100
    quarter = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    world = (truth - truth.mean(0)) @ quarter
    np.testing.assert_allclose(placed(world, points, confidence, K), truth, atol=1e-3)
