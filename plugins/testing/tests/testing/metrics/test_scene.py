"""Errors of scenes that are wrong in a known way."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physic_testing.metrics import scene_error

pytestmark = pytest.mark.quick

ALL = np.ones((6, 8), bool)


def room(seed=0):
    rng = np.random.default_rng(seed)
    depth = rng.uniform(1, 5, (6, 8, 1))
    return np.concatenate([rng.uniform(-0.5, 0.5, (6, 8, 2)), np.ones((6, 8, 1))], -1) * depth


@given(st.floats(0.3, 3), st.integers(0, 2**32 - 1))
def test_a_scale_is_seen_in_every_number(scale, seed):
    truth = room(seed)
    error = scene_error(scale * truth, truth, ALL, ALL)
    assert error.log_scale == pytest.approx(math.log(scale), abs=1e-9)
    assert error.depth_relative_median == pytest.approx(abs(scale - 1))
    assert error.depth_relative_mean == pytest.approx(abs(scale - 1))
    assert error.point_mean == pytest.approx(abs(scale - 1) * np.linalg.norm(truth, axis=-1).mean())
    assert error.point_median == pytest.approx(
        abs(scale - 1) * np.median(np.linalg.norm(truth, axis=-1))
    )
    if abs(math.log(scale / 1.25)) > 1e-9 and abs(math.log(scale * 1.25)) > 1e-9:
        assert error.delta_share == (1 / 1.25 < scale < 1.25)


def test_one_bad_pixel_moves_the_mean_and_not_the_median():
    truth = np.zeros((1, 4, 3))
    truth[..., 2] = 2
    predicted = truth.copy()
    predicted[0, 0] = [3, 0, 6]
    valid = np.ones((1, 4), bool)
    error = scene_error(predicted, truth, valid, valid)
    assert (error.depth_relative_median, error.depth_relative_mean) == (0, pytest.approx(0.5))
    assert (error.point_median, error.point_mean) == (0, pytest.approx(5 / 4))
    assert error.delta_share == 0.75
    assert error.log_scale == 0


def test_only_pixels_valid_in_both_count_and_the_rest_is_reported():
    truth = room()
    predicted = room()
    predicted[0, 0] = np.nan
    predicted[0, 1] = np.inf
    predicted[0, 2, 2] = -1
    is_predicted = ALL.copy()
    is_known = ALL.copy()
    predicted[1] += 100
    is_predicted[1] = False
    truth[2, :4] = np.nan
    is_known[3, :4] = False
    error = scene_error(predicted, truth, is_predicted, is_known)
    assert error.pixels == 48 - 3 - 8 - 8
    assert error.coverage == pytest.approx(29 / 40)
    assert (error.point_mean, error.depth_relative_mean) == (0, 0)
