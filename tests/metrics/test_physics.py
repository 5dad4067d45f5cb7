"""Penetration and floating of boxes and balls whose answer is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from physic_core.geometry.mesh import vertex_areas
from physic_core.metrics import contact_gap, penetration

RADIUS = 0.5


@pytest.fixture(scope="module")
def ball():
    return trimesh.creation.icosphere(subdivisions=5, radius=RADIUS)


@pytest.mark.parametrize("sunk", [0.05, 0.1, 0.3])
def test_a_ball_in_the_floor_has_the_volume_of_its_cap(ball, sunk):
    heights = ball.vertices[:, 2] + RADIUS - sunk
    areas = vertex_areas(ball.vertices, ball.faces)
    plain = penetration(heights, areas)
    exact = penetration(heights, areas, facing=np.where(heights < 0, -ball.vertices[:, 2] / RADIUS, np.nan))
    cap = math.pi * sunk**2 * (RADIUS - sunk / 3)
    assert exact.volume == pytest.approx(cap, rel=0.02)
    assert plain.volume == pytest.approx(cap / (1 - sunk / (3 * RADIUS)), rel=0.02)
    assert plain.max_depth == pytest.approx(sunk, abs=1e-3)
    assert plain.mean_depth == pytest.approx(sunk / 2, rel=0.05)  # heights of a ball's surface are uniform
    assert plain.share == pytest.approx(sunk / (2 * RADIUS), rel=0.1)


def test_known_points_have_the_known_depths():
    distance = np.array([[0.2, -0.01, -0.03, np.inf, np.nan], [0.1, 0.0, 0.3, np.inf, np.nan]])
    answer = penetration(distance, np.full((2, 5), 0.5))
    np.testing.assert_allclose(answer.max_depth, [0.03, 0])
    np.testing.assert_allclose(answer.mean_depth, [0.02, 0])
    np.testing.assert_allclose(answer.share, [0.4, 0])
    np.testing.assert_allclose(answer.volume, [0.02, 0])
    outer = np.array([True, True, False, True, True])
    masked = penetration(distance, np.full(5, 0.5), counted=outer)
    np.testing.assert_allclose(masked.max_depth, [0.01, 0])
    np.testing.assert_allclose(masked.mean_depth, [0.01, 0])
    np.testing.assert_allclose(masked.share, [0.25, 0])
    np.testing.assert_allclose(masked.volume, [0.005, 0])


@given(st.lists(st.floats(-0.2, 0.2), min_size=1, max_size=20), st.floats(0.1, 10))
def test_depths_scale_with_the_scene_and_the_volume_with_the_areas(values, scale):
    distance, areas = np.array(values), np.linspace(0.1, 1, len(values))
    one, other = penetration(distance, areas), penetration(scale * distance, areas)
    assert other.max_depth == pytest.approx(scale * one.max_depth)
    assert other.mean_depth == pytest.approx(scale * one.mean_depth)
    assert penetration(distance, scale * areas).volume == pytest.approx(scale * one.volume)
    assert one.mean_depth <= one.max_depth + 1e-12


def test_true_contacts_are_missed_by_their_mean_gap():
    distance = np.array([[0.02, 0.04, -0.05, 9.0], [np.inf, 0.05, np.nan, 0.0], [1.0, 1.0, 1.0, 1.0]])
    contact = np.array([[1, 1, 1, 0], [1, 1, 1, 0], [0, 0, 0, 0]], bool)
    np.testing.assert_allclose(contact_gap(distance, contact), [0.02, np.inf, np.nan])
    np.testing.assert_allclose(contact_gap(distance, contact, reach=0.15), [0.02, 0.35 / 3, np.nan])
