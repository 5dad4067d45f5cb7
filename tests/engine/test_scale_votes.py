"""Votes on the scale of a scene: the most certain evidence dominates."""

from __future__ import annotations

import math

import numpy as np
import pytest

from physic_core.engine.sizes.evidence import KNOWN_SCALE_SIGMA, ScaleEvidence, combined_scale
from physic_core.engine.sizes.scale_vote import Witnesses, vote_on_scale


def test_known_sizes_give_their_geometric_mean_and_dominate_a_guess():
    known = [ScaleEvidence.by_known_size(metres, 1.0) for metres in (2.0, 2.1)]
    both = combined_scale(known)
    assert math.exp(both.log_scale) == pytest.approx(math.sqrt(2.0 * 2.1))
    assert both.sigma == KNOWN_SCALE_SIGMA
    with_guess = combined_scale([*known, ScaleEvidence(math.log(4.0), 0.5)])
    assert with_guess.log_scale == pytest.approx(both.log_scale, abs=1e-3)
    assert combined_scale([]) is None


def witnesses(scales, sigma=0.06, sure=0.9, shared=0.0, wrong=0.0):
    every = np.ones(len(scales))
    return Witnesses(np.array(scales), every, every * sigma, every * sure, shared, wrong)


def vote(*given):
    return vote_on_scale([witnesses(*given)])


def test_witnesses_of_known_stature_outvote_a_majority_of_unknown_stature():
    scales = [1.0, 1.3, 1.3, np.nan]
    assert vote(scales).scale.scale == pytest.approx(1.3, rel=0.02)
    sigma = np.array([0.005, 0.06, 0.06, 0.06])
    sure = np.array([1.0, 0.9, 0.9, 0.9])
    assert vote(scales, sigma, sure).scale.scale == pytest.approx(1.0, rel=0.02)


def test_an_error_that_all_share_does_not_shrink_with_their_number():
    few, many = (vote([2.0] * count, 0.06, 1.0, 0.05).scale for count in (1, 25))
    assert few.sigma == pytest.approx(math.hypot(0.06, 0.05), rel=0.05)
    assert many.sigma == pytest.approx(math.hypot(0.06 / 5, 0.05), rel=0.05)
    assert [few.scale, many.scale] == pytest.approx([2.0, 2.0])


def test_a_witness_who_is_far_off_counts_little():
    assert vote([1.0, 1.0, 1.0, 3.0]).scale.scale == pytest.approx(1.0, rel=0.02)


def test_a_plane_at_which_the_witnesses_agree_is_more_likely():
    planes = [[witnesses([m], 0.1)] for m in (1.0, 2.0)]
    found = vote_on_scale([witnesses([1.0], 0.1, 1.0)], planes, [0.0, 0.0])
    assert found.weights[0] > 0.9
    assert found.weights.sum() == pytest.approx(1)


def test_the_scale_is_unknown_if_no_witness_says_anything():
    assert vote([np.nan]) is None
    assert vote_on_scale([]) is None
