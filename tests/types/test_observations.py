"""Evidence of what a network sees of people: what it says beyond the share of its data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core.types import POSTURES, TOUCH_PARTS, Observations
from physic_core.types.observations import PROBABILITIES

UNKNOWN = Observations.unknown(2)


@pytest.mark.parametrize("name", PROBABILITIES)
def test_what_is_not_said_is_no_evidence(name):
    found = UNKNOWN.evidence(name)
    assert found.shape == getattr(UNKNOWN, name).shape
    assert not found.any()


def test_evidence_is_the_log_odds_beyond_those_of_the_share():
    touch = np.full((2, len(TOUCH_PARTS)), np.nan, np.float32)
    touch[0, :3] = 0.8, 0.5, 0.2
    share = np.full(len(TOUCH_PARTS), 0.5, np.float32)
    share[2] = 0.2
    found = replace(UNKNOWN, touch=touch, touch_share=share).evidence("touch")
    np.testing.assert_allclose(found[0], [np.log(4), 0, 0, 0, 0], atol=1e-6)
    assert not found[1].any()


def test_evidence_of_a_posture_is_the_log_of_its_ratio_to_the_share():
    posture = np.zeros((2, len(POSTURES)), np.float32)
    posture[:, :2] = 0.75, 0.25
    share = np.zeros(len(POSTURES), np.float32)
    share[:2] = 0.5
    found = replace(UNKNOWN, posture=posture, posture_share=share).evidence("posture")
    np.testing.assert_allclose(found[0], [np.log(1.5), np.log(0.5), *[0] * 7], atol=1e-6)


def test_left_and_right_limbs_of_some_people_change_places():
    touch = np.tile(np.linspace(0.1, 0.5, 5), (2, 1))
    said = replace(UNKNOWN, touch=touch, holds=touch[:, :2], on_floor=touch[:, 2:4])
    found = said.with_sides_exchanged(np.array([False, True]))
    np.testing.assert_allclose(found.touch, [[0.1, 0.2, 0.3, 0.4, 0.5], [0.2, 0.1, 0.4, 0.3, 0.5]])
    np.testing.assert_allclose(found.holds, [[0.1, 0.2], [0.2, 0.1]])
    np.testing.assert_allclose(found.on_floor, [[0.3, 0.4], [0.4, 0.3]])


def test_certainty_is_finite_evidence():
    found = replace(UNKNOWN, child=np.array([0.0, 1.0]), child_share=0.5).evidence("child")
    np.testing.assert_allclose(found, [-9.21, 9.21], atol=1e-2)
