"""Backgrounds of photos: pixels that match, and the same picture twice."""

from __future__ import annotations

import numpy as np
import pytest

from physic_scene.background import (
    Background,
    BackgroundSettings,
    BackgroundTurn,
    background_turn,
    same_photo,
)
from physic_scene.rigid import angle_deg

SETTINGS = BackgroundSettings()
K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
HALF_TURN = np.diag([-1.0, 1.0, -1.0])
NO_PIXELS = (np.zeros((0, 2)), np.zeros((0, 2)))


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
    found = background_turn(*views, (K, K), SETTINGS)
    assert found is not None
    assert found.llr > 100
    assert len(found.first) > 70
    rows = [np.flatnonzero((views[0].points == pixel).all(1)).item() for pixel in found.first]
    assert np.array_equal(found.second, views[1].points[rows])


def test_few_or_degenerate_pixels_are_no_error(views):
    few = background(views[0].points[:5], views[0].descriptors[:5])
    assert background_turn(few, views[1], (K, K), SETTINGS) is None
    straight = np.column_stack([np.arange(80.0), np.full(80, 5.0)])
    line = background(straight, views[0].descriptors)
    background_turn(line, line, (K, K), SETTINGS)


def test_the_background_gives_the_turn_of_the_cameras_despite_wrong_matches(views):
    one, two = views
    wrong = np.arange(80) % 2 == 0
    mixed = np.where(wrong[:, None], np.random.default_rng(4).permutation(two.points), two.points)
    found = background_turn(one, background(mixed, two.descriptors), (K, K), SETTINGS)
    assert found is not None
    assert found.llr > 30
    assert angle_deg(found.rotation, np.eye(3)) < 5
    assert found.supports(np.eye(3)) > found.supports(HALF_TURN) + 30
    row = {tuple(pixel): k for k, pixel in enumerate(one.points)}
    agrees = [not wrong[row[tuple(pixel)]] for pixel in found.first]
    assert np.mean(agrees) > 0.9


def test_matches_by_chance_say_nothing_about_the_cameras(views):
    one, two = views
    for seed in range(5):
        points = np.random.default_rng(seed).permutation(two.points)
        chance = background_turn(one, background(points, two.descriptors), (K, K), SETTINGS)
        assert chance is not None
        assert chance.llr < 0
    assert BackgroundTurn(np.eye(3), -9.2, *NO_PIXELS).supports(np.eye(3)) < 0.1


def test_a_brighter_copy_is_the_same_photo():
    rng = np.random.default_rng(2)
    none = np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    grey = rng.uniform(-60, 60, (32, 32))
    photo, brighter, other = (Background(*none, picture) for picture in (grey, 1.2 * grey, grey[::-1]))
    assert same_photo(photo, brighter)
    assert not same_photo(photo, other)
