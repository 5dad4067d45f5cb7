"""Backgrounds of photos: pixels that match, the same picture twice, and pictures in a mirror."""

from __future__ import annotations

import numpy as np
import pytest

from physic_scene.background import (
    Background,
    BackgroundSettings,
    BackgroundTurn,
    background_turn,
    match_background,
    same_photo,
)
from physic_scene.rigid import angle_deg

SETTINGS = BackgroundSettings()
K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
HALF_TURN = np.diag([-1.0, 1.0, -1.0])


def background(points, descriptors, rng):
    mirrored_points = points * [-1, 1] + [640, 0]
    mirrored = rng.random((len(points), 128), np.float32)
    return Background(points, descriptors, mirrored_points, mirrored, np.zeros((32, 32)))


@pytest.fixture
def views():
    """Return the pixels of 80 points in two cameras, one metre apart."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-2, 2, 80), rng.uniform(-1.5, 1.5, 80), rng.uniform(3, 7, 80)])
    descriptors = rng.random((80, 128), np.float32)
    pixels = [500 * (points - [x, 0, 0])[:, :2] / points[:, 2:] + [320, 240] for x in (0.0, 1.0)]
    return [background(one, descriptors, rng) for one in pixels]


def test_pixels_of_the_same_points_match(views):
    found = match_background(*views, (0, 1), SETTINGS)
    assert found is not None
    assert len(found.first) > 70
    assert found.views == (0, 1)


def test_few_or_degenerate_pixels_are_no_error(views):
    few = background(views[0].points[:10], views[0].descriptors[:10], np.random.default_rng(1))
    assert match_background(few, views[1], (0, 1), SETTINGS) is None
    straight = np.column_stack([np.arange(80.0), np.full(80, 5.0)])
    line = background(straight, views[0].descriptors, np.random.default_rng(1))
    match_background(line, line, (0, 1), SETTINGS)


def test_the_background_gives_the_turn_of_the_cameras_despite_wrong_matches(views):
    one, two = views
    wrong = np.arange(80) % 2 == 0
    mixed = np.where(wrong[:, None], np.random.default_rng(4).permutation(two.points), two.points)
    found = background_turn(one, background(mixed, two.descriptors, np.random.default_rng(1)), (K, K), SETTINGS)
    assert found is not None
    assert found.llr > 30
    assert angle_deg(found.rotation, np.eye(3)) < 5
    assert found.supports(np.eye(3)) > found.supports(HALF_TURN) + 30


def test_matches_by_chance_say_nothing_about_the_cameras(views):
    one, two = views
    for seed in range(5):
        rng = np.random.default_rng(seed)
        chance = background_turn(one, background(rng.permutation(two.points), two.descriptors, rng), (K, K), SETTINGS)
        assert chance is not None
        assert chance.llr < 0
    assert BackgroundTurn(np.eye(3), -9.2).supports(np.eye(3)) < 0.1
    few = background(one.points[:5], one.descriptors[:5], np.random.default_rng(1))
    assert background_turn(few, two, (K, K), SETTINGS) is None


def test_a_picture_in_a_mirror_matches_its_mirror_image(views):
    one, two = views
    turned = two.in_a_mirror()
    upright, mirrored = (background_turn(one, other, (K, K), SETTINGS) for other in (turned, turned.in_a_mirror()))
    assert mirrored is not None
    assert mirrored.llr > 100
    assert upright is None or upright.llr < 0


def test_a_brighter_copy_is_the_same_photo():
    rng = np.random.default_rng(2)
    none = np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    grey = rng.uniform(-60, 60, (32, 32))
    photo, brighter, other = (Background(*none, *none, picture) for picture in (grey, 1.2 * grey, grey[::-1]))
    assert same_photo(photo, brighter)
    assert not same_photo(photo, other)
