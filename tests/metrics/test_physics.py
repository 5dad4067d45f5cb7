"""Penetration and floating of boxes and balls whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from physic_core.metrics import contact_gap, penetration

pytestmark = pytest.mark.quick

RADIUS = 0.5


@pytest.mark.parametrize("sunk", [0.05, 0.1, 0.3])
def test_a_ball_in_the_floor_is_inside_by_half_its_depth(sunk):
    found = penetration(trimesh.creation.icosphere(5, RADIUS).vertices[:, 2] + RADIUS - sunk)
    assert found.max_depth == pytest.approx(sunk, abs=1e-3)
    # heights of a ball's surface are uniform
    assert found.mean_depth == pytest.approx(sunk / 2, rel=0.05)
    assert found.share == pytest.approx(sunk / (2 * RADIUS), rel=0.1)


def test_known_points_have_the_known_depths():
    distance = np.array([[0.2, -0.01, -0.03, np.inf, np.nan], [0.1, 0.0, 0.3, np.inf, np.nan]])
    found = penetration(distance)
    masked = penetration(distance, np.array([True, True, False, True, True]))
    np.testing.assert_allclose(
        [found.max_depth, found.mean_depth, found.share], [[0.03, 0], [0.02, 0], [0.4, 0]]
    )
    np.testing.assert_allclose(
        [masked.max_depth, masked.mean_depth, masked.share], [[0.01, 0], [0.01, 0], [0.25, 0]]
    )


@given(st.lists(st.floats(-0.2, 0.2), min_size=1, max_size=20), st.floats(0.1, 10))
def test_depths_scale_with_the_scene(values, scale):
    one = penetration(np.array(values))
    other = penetration(scale * np.array(values))
    assert other.max_depth == pytest.approx(scale * one.max_depth)
    assert other.mean_depth == pytest.approx(scale * one.mean_depth)


def test_true_contacts_are_missed_by_their_mean_gap():
    distance = np.array(
        [[0.02, 0.04, -0.05, 9.0], [np.inf, 0.05, np.nan, 0.0], [1.0, 1.0, 1.0, 1.0]]
    )
    contact = np.array([[1, 1, 1, 0], [1, 1, 1, 0], [0, 0, 0, 0]], bool)
    np.testing.assert_allclose(contact_gap(distance, contact), [0.02, np.inf, np.nan])
    np.testing.assert_allclose(contact_gap(distance, contact, reach=0.15), [0.02, 0.35 / 3, np.nan])
