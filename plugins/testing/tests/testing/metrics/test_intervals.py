"""Bootstrap intervals, and tables of results."""

from __future__ import annotations

import math

import numpy as np
import pytest

from physic_testing.metrics import (
    draw_counts,
    percentile_interval,
    resampled_interval,
)

pytestmark = pytest.mark.quick


def mean_of_groups(drawn):
    return float(np.mean([value for stratum in drawn for value in stratum]))


def test_every_draw_has_as_many_groups_as_there_are():
    counts = draw_counts(7, 50)
    assert counts.shape == (50, 7)
    assert (counts.sum(1) == 7).all()
    np.testing.assert_array_equal(counts, draw_counts(7, 50))


def test_the_interval_of_a_mean_is_two_standard_errors_to_either_side():
    values = np.random.default_rng(1).normal(3.0, 2.0, 400)
    for low, high in (
        percentile_interval(draw_counts(400) @ values / 400),
        resampled_interval([values.tolist()], mean_of_groups, 1000),
    ):
        error = values.std() / 20
        assert (values.mean() - low, high - values.mean()) == pytest.approx(
            (1.96 * error, 1.96 * error), rel=0.15
        )


@pytest.mark.parametrize("strata", [[], [[1.0, 2.0], [3.0]]])
def test_a_stratum_of_one_group_gives_no_interval(strata):
    assert all(map(math.isnan, resampled_interval(strata, mean_of_groups)))


def test_draws_without_a_value_do_not_count():
    assert percentile_interval([math.nan, 2.0, 2.0]) == (2.0, 2.0)
    assert all(map(math.isnan, percentile_interval([math.nan])))
