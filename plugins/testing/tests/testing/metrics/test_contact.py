"""Precision, recall and F1 of contact, in the three averages and at the edges."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from physic_core.errors import PhysicError
from physic_testing.metrics import contact_counts, contact_scores, precision_recall_f1

pytestmark = pytest.mark.quick

MAPS = st.tuples(st.integers(1, 6), st.integers(1, 8)).flatmap(
    lambda shape: st.tuples(arrays(bool, shape), arrays(bool, shape))
)


def flags(*rows):
    return np.array([[c == "1" for c in row] for row in rows])


def twin(guess, fact):
    """The rule of the published code, in words of sets."""
    predicted = set(np.flatnonzero(guess))
    true = set(np.flatnonzero(fact))
    if not predicted:
        return 1.0, 0.0, 0.0
    if not true:
        return 0.0, 1.0, 0.0
    p = len(predicted & true) / len(predicted)
    r = len(predicted & true) / len(true)
    return p, r, 2 * p * r / (p + r) if p + r else 0.0


def test_the_means_of_two_people_by_hand():
    # P = 1/1, 1/3; R = 1/2, 1/1; F1 = 2/3, 1/2.
    scores = contact_scores(flags("10000", "11100"), flags("11000", "10000"))
    assert scores.rows == 2
    assert (scores.precision_mean, scores.recall_mean, scores.f1_of_means) == pytest.approx(
        (2 / 3, 3 / 4, 12 / 17)
    )


@given(MAPS)
def test_the_rates_equal_the_slow_reference(maps):
    predicted, truth = maps
    expected = np.array([twin(*row) for row in zip(predicted, truth, strict=True)])
    np.testing.assert_allclose(
        np.stack(precision_recall_f1(contact_counts(predicted, truth)), 1), expected
    )
    scores = contact_scores(predicted, truth)
    assert scores.f1_mean == pytest.approx(expected[:, 2].mean())
    pooled = twin(predicted.ravel(), truth.ravel())
    assert (scores.precision_pooled, scores.recall_pooled, scores.f1_pooled) == pytest.approx(
        pooled
    )


def test_probabilities_and_other_meshes_are_refused():
    truth = flags("0110")
    with pytest.raises(PhysicError, match="must be bool, got float64"):
        contact_counts(np.full((1, 4), 0.3), truth)
    with pytest.raises(PhysicError, match=r"\(1, 4\) and \(1, 5\)"):
        contact_counts(truth, flags("01100"))
