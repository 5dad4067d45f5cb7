"""Who is who: matches by hand, a slow twin, and people who are missing."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physic_testing.metrics import mask_iou, match_by_masks

pytestmark = pytest.mark.quick


def columns(*spans, width=20):
    """Masks of 4 rows, each a span of columns."""
    masks = np.zeros((len(spans), 4, width), bool)
    for mask, (start, end) in zip(masks, spans, strict=True):
        mask[:, start:end] = True
    return masks


def pairs(matching):
    return dict(zip(matching.truth.tolist(), matching.predicted.tolist(), strict=True))


def test_known_boxes_have_the_known_overlap():
    iou = mask_iou(columns((0, 4), (2, 6), (3, 3)), columns((0, 4), (10, 12), (5, 5)))
    np.testing.assert_allclose(iou, [[1, 0, 0], [2 / 6, 0, 0], [0, 0, 0]])


def test_the_gate_includes_its_bound_and_never_no_overlap():
    assert pairs(match_by_masks(columns((0, 4)), columns((0, 8)), min_iou=0.5)) == {0: 0}
    assert pairs(match_by_masks(columns((0, 4)), columns((0, 8)), min_iou=0.51)) == {}
    assert pairs(match_by_masks(columns((0, 4)), columns((4, 8)), min_iou=0)) == {}


@given(st.integers(0, 2**32 - 1), st.integers(0, 4), st.integers(0, 4), st.floats(0.05, 0.8))
def test_matches_equal_the_slow_reference(seed, guesses, people, gate):
    rng = np.random.default_rng(seed)
    predicted, truth = (
        columns(*np.sort(rng.integers(0, 20, (count, 2)))) for count in (guesses, people)
    )
    overlap = mask_iou(predicted, truth)
    cost = np.where(overlap >= gate, 1 - overlap, np.inf)
    slots = [*range(guesses), *[None] * people]
    options = []
    for choice in set(permutations(slots, people)):
        taken = {j: i for j, i in enumerate(choice) if i is not None}
        if all(np.isfinite(cost[i, j]) for j, i in taken.items()):
            options.append((-len(taken), sum(cost[i, j] for j, i in taken.items())))
    matching = match_by_masks(predicted, truth, min_iou=gate)
    matches = pairs(matching)
    assert (-len(matches), sum(cost[i, j] for j, i in matches.items())) == pytest.approx(
        min(options)
    )
    assert sorted([*matching.truth, *matching.missed]) == list(range(people))
    assert sorted([*matching.predicted, *matching.false_alarms]) == list(range(guesses))
