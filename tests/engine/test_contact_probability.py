"""The probability of contact: bounds, order and extremes of its formula, and the threshold."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from physic_core.engine.contact.probability import (
    OWN_HAND,
    SELF,
    SURFACES,
    contact_probability,
    facing_probability,
)
from physic_core.engine.presets import PRESETS

SETTINGS = PRESETS["default"].contact
KINDS = st.integers(0, len(SURFACES) - 1)


def probability(distance: float, kind: int = 0, *, seen: bool = True, prior: float = 0.05) -> float:
    one = contact_probability(
        torch.tensor([distance]), torch.tensor([kind]), torch.tensor([seen]), torch.tensor([prior]), SETTINGS
    )
    return float(one[0])


@given(st.floats(-0.15, 0.15), KINDS, st.booleans(), st.floats(0, 1))
def test_it_is_a_probability(distance: float, kind: int, seen: bool, prior: float):
    assert 0 < probability(distance, kind, seen=seen, prior=prior) < 1


@given(st.floats(0.02, 0.12), st.floats(0.005, 0.03), KINDS, st.booleans())
def test_it_falls_with_the_distance(distance: float, step: float, kind: int, seen: bool):
    assert probability(distance + step, kind, seen=seen) < probability(distance, kind, seen=seen)


@given(st.floats(-0.05, 0.15), st.sampled_from([1, 2]), st.booleans(), st.floats(0.1, 0.5))
def test_a_higher_prior_raises_it(distance: float, kind: int, seen: bool, prior: float):
    assert probability(distance, kind, seen=seen, prior=prior + 0.4) > probability(
        distance, kind, seen=seen, prior=prior
    )


@given(st.floats(-0.05, 0.15), st.booleans(), st.floats(0, 1))
def test_the_prior_tells_nothing_of_contact_with_the_floor(distance: float, seen: bool, prior: float):
    assert probability(distance, 0, seen=seen, prior=prior) == probability(distance, 0, seen=seen)


@given(KINDS, st.booleans(), st.floats(0, 1))
def test_it_is_zero_beyond_the_search_radius(kind: int, seen: bool, prior: float):
    assert probability(torch.inf, kind, seen=seen, prior=prior) == 0


def test_the_floor_is_surest():
    assert probability(0.0, 0) > 0.95 > 0.7 > max(probability(0.0, kind) for kind in range(1, len(SURFACES)))


def test_a_hand_near_the_own_body_is_surer_than_other_parts_at_some_distance():
    hand, other = (SURFACES.index(kind) for kind in (OWN_HAND, SELF))
    assert probability(0.04, hand) > 3 * probability(0.04, other)


def test_without_a_prior_the_probability_is_that_of_the_distance():
    one = torch.tensor([0.0])
    kind, seen = torch.tensor([SURFACES.index(SELF)]), torch.tensor([True])
    expected = 0.5 * (math.erf(0.02 / SELF.sigma_m / 2**0.5) + math.erf(0.05 / SELF.sigma_m / 2**0.5))
    right = 1 / (1 + math.exp(-SELF.log_odds))
    found = float(contact_probability(one, kind, seen, None, SETTINGS))
    assert found == pytest.approx(right * expected + (1 - right) * SELF.share, abs=1e-3)


def test_a_limb_that_the_photo_shows_is_surer():
    for kind in (1, 2):
        assert probability(0.0, kind) > probability(0.0, kind, seen=False)


def test_skin_that_faces_a_surface_touches_it_and_skin_that_looks_along_it_or_away_does_not():
    ahead, beside, away, unknown = facing_probability(torch.tensor([1.0, 0.0, -1.0, torch.nan])).tolist()
    assert ahead > 0.88
    assert beside < 0.2
    assert away < 0.01
    assert unknown == 1
