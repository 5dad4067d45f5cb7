"""Penetration and floating of points whose distances are known."""

from __future__ import annotations

import numpy as np
import pytest

from physic_testing.metrics import contact_gap, penetration

pytestmark = pytest.mark.quick


def test_known_points_have_the_known_depths():
    distance = np.array([[0.2, -0.01, -0.03, np.inf, np.nan], [0.1, 0.0, 0.3, np.inf, np.nan]])
    depths = penetration(distance)
    np.testing.assert_allclose([depths.max_depth, depths.mean_depth], [[0.03, 0], [0.02, 0]])


def test_true_contacts_are_missed_by_their_mean_gap():
    distance = np.array(
        [[0.02, 0.04, -0.05, 9.0], [np.inf, 0.05, np.nan, 0.0], [1.0, 1.0, 1.0, 1.0]]
    )
    contact = np.array([[1, 1, 1, 0], [1, 1, 1, 0], [0, 0, 0, 0]], bool)
    np.testing.assert_allclose(contact_gap(distance, contact), [0.02, np.inf, np.nan])
    np.testing.assert_allclose(contact_gap(distance, contact, reach=0.15), [0.02, 0.35 / 3, np.nan])
