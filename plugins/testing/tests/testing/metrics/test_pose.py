"""Errors of joints and vertices: answers by hand, a slow twin, and what may and may not change
them.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from physic_testing.metrics import align_similarity, mpjpe_mm, mpvpe_mm, pa_mpjpe_mm

pytestmark = pytest.mark.quick

SEEDS = st.integers(0, 2**32 - 1)


def person(seed, joints=22):
    return np.random.default_rng(seed).normal(0, 0.4, (joints, 3)) + np.array([0.3, -0.2, 4.0])


def twin(predicted, truth):
    """Umeyama's closed form for one person, by the singular values."""
    centre = predicted.mean(0)
    goal = truth.mean(0)
    u, d, vt = np.linalg.svd((truth - goal).T @ (predicted - centre) / len(truth))
    sign = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    scale = (d * sign).sum() / np.square(predicted - centre).sum(1).mean()
    return scale * (predicted - centre) @ (u * sign @ vt).T + goal


def test_a_shift_is_its_length_without_alignment_and_nothing_with_it():
    truth = np.stack([person(0), person(1)])
    moved = truth + np.array([[[0.03, 0.0, 0.04]], [[0.0, 0.0, 1.0]]])
    np.testing.assert_allclose(mpjpe_mm(moved, truth), [50, 1000])
    np.testing.assert_allclose(mpvpe_mm(moved, truth), [50, 1000])
    np.testing.assert_allclose(pa_mpjpe_mm(moved, truth), 0, atol=1e-9)


def test_one_joint_off_counts_by_its_share():
    truth = person(0)
    moved = truth.copy()
    moved[3] += [0, 0.22, 0]
    assert mpjpe_mm(moved, truth) == pytest.approx(220 / 22)
    valid = np.arange(22) != 3
    assert mpjpe_mm(moved, truth, valid) == 0
    assert pa_mpjpe_mm(moved, truth, valid) == pytest.approx(0, abs=1e-9)


@given(SEEDS, st.floats(0, 0.3))
def test_the_alignment_equals_the_slow_reference(seed, noise):
    rng = np.random.default_rng(seed)
    truth = np.stack([person(seed), person(seed + 1)])
    predicted = truth @ Rotation.random(random_state=seed % 2**31).as_matrix() + noise * rng.normal(
        size=truth.shape
    )
    aligned = align_similarity(predicted, truth)
    for row, guess, fact in zip(aligned, predicted, truth, strict=True):
        np.testing.assert_allclose(row, twin(guess, fact), atol=1e-9)


def test_a_mirror_image_is_not_aligned_away():
    truth = person(0)
    assert pa_mpjpe_mm(truth * [-1, 1, 1], truth) > 50


def test_degenerate_people_have_the_error_that_is_left():
    truth = person(0)
    spread = 1000 * np.linalg.norm(truth - truth.mean(0), axis=1).mean()
    assert pa_mpjpe_mm(np.full((22, 3), 7.0), truth) == pytest.approx(spread)
    assert pa_mpjpe_mm(np.full((22, 3), 0.1, np.float32), truth) == pytest.approx(spread)
    assert pa_mpjpe_mm(truth, np.zeros((22, 3))) == pytest.approx(0, abs=1e-9)
    assert pa_mpjpe_mm(np.ones((1, 3)), np.zeros((1, 3))) == 0
    line = np.linspace(0, 1, 5)[:, None] * [1.0, 2.0, 3.0]
    assert pa_mpjpe_mm(line, line[:, ::-1] + 4) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_person_that_failed_is_nan_and_changes_no_other_person(bad):
    truth = np.stack([person(0), person(1)])
    predicted = truth + 0.01
    predicted[0, 5, 1] = bad
    for metric in (mpjpe_mm, mpvpe_mm, pa_mpjpe_mm):
        errors = metric(predicted, truth)
        assert np.isnan(errors[0])
        assert np.isfinite(errors[1])
    valid = np.ones((2, 22), bool)
    valid[0, 5] = False
    assert np.isfinite(mpjpe_mm(predicted, truth, valid)).all()
    np.testing.assert_allclose(pa_mpjpe_mm(predicted, truth, valid), 0, atol=1e-9)
