"""Backgrounds of photos: pixels that match, and the same picture twice."""

from __future__ import annotations

import numpy as np
import pytest

from physic_scene.background import (
    Background,
    BackgroundSettings,
    same_background,
    same_photo,
)

SETTINGS = BackgroundSettings()
K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])


def background(points, descriptors):
    return Background(points, descriptors, np.zeros((32, 32)))


@pytest.fixture
def views():
    """Return the pixels of 80 points in two cameras, one metre apart."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-2, 2, 80), rng.uniform(-1.5, 1.5, 80), rng.uniform(3, 7, 80)])
    descriptors = rng.random((80, 128), np.float32)
    pixels = [500 * (points - [x, 0, 0])[:, :2] / points[:, 2:] + [320, 240] for x in (0.0, 1.0)]
    return [background(one, descriptors) for one in pixels]


def test_pixels_of_the_same_points_match(views):
    found = same_background(*views, (K, K), (0, 1), SETTINGS)
    assert found is not None
    assert found.views == (0, 1)
    assert len(found.first) > 70
    rows = [np.flatnonzero((views[0].points == pixel).all(1)).item() for pixel in found.first]
    assert np.array_equal(found.second, views[1].points[rows])


def test_few_or_degenerate_pixels_are_no_error(views):
    few = background(views[0].points[:5], views[0].descriptors[:5])
    assert same_background(few, views[1], (K, K), (0, 1), SETTINGS) is None
    straight = np.column_stack([np.arange(80.0), np.full(80, 5.0)])
    line = background(straight, views[0].descriptors)
    same_background(line, line, (K, K), (0, 1), SETTINGS)


def test_wrong_matches_are_outliers_of_the_motion(views):
    one, two = views
    wrong = np.arange(80) % 2 == 0
    mixed = np.where(wrong[:, None], np.random.default_rng(4).permutation(two.points), two.points)
    found = same_background(one, background(mixed, two.descriptors), (K, K), (0, 1), SETTINGS)
    assert found is not None
    row = {tuple(pixel): k for k, pixel in enumerate(one.points)}
    agrees = [not wrong[row[tuple(pixel)]] for pixel in found.first]
    assert np.mean(agrees) > 0.9


def test_matches_by_chance_are_none(views):
    one, two = views
    for seed in range(5):
        points = np.random.default_rng(seed).permutation(two.points)
        assert same_background(one, background(points, two.descriptors), (K, K), (0, 1), SETTINGS) is None


def test_a_brighter_copy_is_the_same_photo():
    rng = np.random.default_rng(2)
    none = np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    grey = rng.uniform(-60, 60, (32, 32))
    photo, brighter, other = (Background(*none, picture) for picture in (grey, 1.2 * grey, grey[::-1]))
    assert same_photo(photo, brighter)
    assert not same_photo(photo, other)
