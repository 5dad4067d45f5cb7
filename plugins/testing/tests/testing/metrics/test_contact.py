"""Precision, recall and F1 of contact, in the three averages and at the edges."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.errors import PhysicError
from physic_testing.metrics import contact_counts, contact_scores

pytestmark = pytest.mark.quick


def flags(*rows):
    return np.array([[c == "1" for c in row] for row in rows])


def test_the_means_of_two_people_by_hand():
    # P = 1/1, 1/3; R = 1/2, 1/1; F1 = 2/3, 1/2.
    scores = contact_scores(flags("10000", "11100"), flags("11000", "10000"))
    assert scores.rows == 2
    assert (scores.precision_mean, scores.recall_mean, scores.f1_of_means) == pytest.approx(
        (2 / 3, 3 / 4, 12 / 17)
    )


def test_probabilities_and_other_meshes_are_refused():
    truth = flags("0110")
    with pytest.raises(PhysicError, match="must be bool, got float64"):
        contact_counts(np.full((1, 4), 0.3), truth)
    with pytest.raises(PhysicError, match=r"\(1, 4\) and \(1, 5\)"):
        contact_counts(truth, flags("01100"))
