"""Fit of stated errors of joints to measured ones."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.joint_errors import fitted
from physic_bench.scoring import LIMB_JOINTS

MOVED = 1.5
OWN_M = 0.06


def test_shares_of_the_evidence_are_recovered_from_errors():
    """Errors of which the lifter's moves tell a part, and hidden keypoints nothing."""
    rng = np.random.default_rng(0)
    people = []
    for _ in range(400):
        moved = rng.uniform(0, 0.2, len(LIMB_JOINTS))
        sigma = np.sqrt(OWN_M**2 + MOVED * moved**2)
        errors = sigma * np.abs(rng.normal(size=len(sigma)))
        errors[0] = np.nan  # unknown
        none = np.zeros_like(moved)
        evidence = np.stack([none + 1, moved**2, none], -1)
        people.append({"joint_errors_m": errors, "evidence": evidence})
    found = fitted(people)
    assert found["moved"]["ankle"] == pytest.approx(MOVED, rel=0.15)
    assert found["own"]["wrist"] == pytest.approx(OWN_M**2, rel=0.25)
