"""Votes on the scale of a scene: the most certain evidence dominates."""

from __future__ import annotations

import math

import numpy as np
import pytest

from physic_core.engine.sizes.evidence import KNOWN_SCALE_SIGMA, ScaleEvidence, combine
from physic_core.engine.sizes.scale_vote import vote_on_scale


def test_known_sizes_give_their_geometric_mean_and_dominate_a_guess() -> None:
    known = [ScaleEvidence.by_known_size(metres, 1.0) for metres in (2.0, 2.1)]
    both = combine(known)
    assert math.exp(both.log_scale) == pytest.approx(math.sqrt(2.0 * 2.1))
    assert both.sigma == KNOWN_SCALE_SIGMA
    with_guess = combine([*known, ScaleEvidence(math.log(4.0), 0.5)])
    assert with_guess.log_scale == pytest.approx(both.log_scale, abs=1e-3)
    assert combine([]) is None


def test_voters_of_known_stature_outvote_a_majority_of_unknown_stature() -> None:
    scales, ones = np.array([1.0, 1.3, 1.3, np.nan]), np.ones(4)
    equal = vote_on_scale(scales, ones, ones, 0.06, 0.0)
    known = vote_on_scale(scales, ones, ones, np.array([0.005, 0.06, 0.06, 0.06]), 0.0)
    assert equal.scale == pytest.approx(1.3, rel=0.01)
    assert known.scale == pytest.approx(1.0, rel=0.01)
    assert known.outliers.tolist() == [False, True, True, False]
