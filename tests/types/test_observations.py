"""Evidence of what a network sees of people: what it says beyond the share of its data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core.types import POSTURES, TOUCH_PARTS, TOUCHED, Observations
from physic_core.types.observations import PROBABILITIES

UNKNOWN = Observations.unknown(2)


@pytest.mark.parametrize("name", PROBABILITIES)
def test_what_is_not_said_is_no_evidence(name):
    found = UNKNOWN.evidence(name)
    assert found.shape == getattr(UNKNOWN, name).shape
    assert not found.any()


def test_evidence_is_the_log_odds_beyond_those_of_the_share():
    on_floor = np.array([[0.8, 0.5], [0.2, np.nan]], np.float32)
    share = np.array([0.5, 0.2], np.float32)
    found = replace(UNKNOWN, on_floor=on_floor, on_floor_share=share).evidence("on_floor")
    np.testing.assert_allclose(found, [[np.log(4), np.log(4)], [-np.log(4), 0]], atol=1e-6)


def test_answers_that_are_never_given_are_no_evidence():
    touch = np.full((2, len(TOUCH_PARTS), len(TOUCHED)), np.nan, np.float32)
    touch[0, 0] = 0.9, 0, 0, 0, 0.1
    share = np.full((len(TOUCH_PARTS), len(TOUCHED)), np.nan, np.float32)
    share[0] = 0.6, 0, 0, 0, 0.4
    found = replace(UNKNOWN, touch=touch, touch_share=share).evidence("touch")
    np.testing.assert_allclose(found[0, 0], [np.log(1.5), 0, 0, 0, np.log(0.25)], atol=1e-6)
    assert not found[0, 1:].any()
    assert not found[1].any()


def test_evidence_of_a_posture_is_the_log_of_its_ratio_to_the_share():
    posture = np.zeros((2, len(POSTURES)), np.float32)
    posture[:, :2] = 0.75, 0.25
    share = np.zeros(len(POSTURES), np.float32)
    share[:2] = 0.5
    found = replace(UNKNOWN, posture=posture, posture_share=share).evidence("posture")
    np.testing.assert_allclose(found[0], [np.log(1.5), np.log(0.5), *[0] * 7], atol=1e-6)


def test_left_and_right_limbs_of_some_people_change_places():
    touch = np.tile(np.arange(10.0)[:, None], (2, 1, 5))
    said = replace(UNKNOWN, touch=touch, on_floor=touch[:, 2:4, 0])
    found = said.with_swapped_sides(np.array([False, True]))
    assert found.touch[0, :, 0].tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]
    assert found.touch[1, :, 0].tolist() == [1, 0, 3, 2, 4, 6, 5, 8, 7, 9]
    assert found.on_floor.tolist() == [[2, 3], [3, 2]]


def test_certainty_is_finite_evidence():
    found = replace(UNKNOWN, child=np.array([0.0, 1.0]), child_share=0.5).evidence("child")
    np.testing.assert_allclose(found, [-9.21, 9.21], atol=1e-2)
