"""Shares of mistakes in what outputs are off by."""

from __future__ import annotations

import numpy as np
import pytest

from physic_testing.conformance.readings import shares

pytestmark = pytest.mark.quick

RNG = np.random.default_rng(0)
MISTAKE = [RNG.normal(size=400) for _ in range(12)]
ERRORS = [RNG.normal(size=400) for _ in range(12)]


@pytest.mark.parametrize("made", [0, 0.5, 1])
def test_the_share_of_a_mistake_is_found_among_other_errors(made):
    off = [made * m + e for m, e in zip(MISTAKE, ERRORS, strict=True)]
    assert np.median(shares(off, MISTAKE)) == pytest.approx(made, abs=0.05)


def test_units_that_do_not_show_a_mistake_say_nothing_of_it():
    mistakes = [MISTAKE[0], 0.001 * MISTAKE[1], np.full(400, np.nan)]
    found = shares(mistakes, mistakes)
    assert found[0] == pytest.approx(1)
    assert np.isnan(found[1:]).all()


def test_what_all_units_have_in_common_does_not_count_if_centred():
    off = [np.array([3.0 + i]) for i in range(4)]
    mistakes = [np.array([float(i)]) for i in range(4)]
    assert shares(off, mistakes, centred=True)[[0, 3]] == pytest.approx(1)
    assert shares(off, mistakes)[3] == pytest.approx(2)
