"""Outliers of points by the mean distance to their nearest neighbours."""

from __future__ import annotations

import pytest
import torch

from physic_paper.outliers import knn_outliers


def random(*shape, seed=0):
    return torch.rand(*shape, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def test_knn_outliers_are_those_of_all_pairs():
    points = random(200, 3, seed=3)
    points[::20] *= 4
    squared = torch.cdist(points, points).square().sort(dim=1).values[:, 1:8].mean(1)
    expected = squared > squared.mean() + 1.45 * squared.std(correction=0)
    assert torch.equal(knn_outliers(points, 7), expected)
    assert 0 < int(expected.sum()) < 20


@pytest.mark.parametrize("count", [0, 1])
def test_knn_outlier_removal_keeps_a_cloud_of_few_points(count):
    assert not knn_outliers(torch.zeros((count, 3)), 5).any()
