"""Eq. 1: each kind of unknown is recovered among outliers, and nothing raises where there is
nothing to align.
"""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.testing import assert_close

from physic_core.geometry.alignment import (
    Alignment,
    AlignmentOptions,
    apply_alignment,
    fit_alignment,
)
from physic_core.geometry.camera import intrinsics_matrix, pixel_rays

pytestmark = pytest.mark.quick

ROWS = 60
COLUMNS = 80
ALL = torch.ones((ROWS, COLUMNS), dtype=torch.bool)
RAYS = pixel_rays(
    ROWS, COLUMNS, intrinsics_matrix(70.0, 70.0, 39.5, 29.5, torch.zeros((), dtype=torch.float64))
)
DEPTH_ALONE = AlignmentOptions(axes="z")
KINDS = ("scale", "scale_shift", "inverse_scale_shift")


def random(*shape, seed=0):
    return torch.rand(*shape, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def room():
    """(H, W, 3) metres: a floor, a wall at 6 m and boxes."""
    depth = torch.minimum(
        1.5 / RAYS[..., 1].clamp(min=0.05), torch.full((ROWS, COLUMNS), 6.0, dtype=torch.float64)
    )
    depth[10:30, 10:25] = 2.5
    depth[15:40, 50:60] = 3.5
    return RAYS * depth[..., None]


def relative(points, unknown, scale, shift):
    """The relative map that ``scale`` and ``shift`` bring back to ``points``."""
    z = points[..., 2]
    if unknown == "scale":
        return points / scale
    if unknown == "scale_shift":
        return (points - torch.tensor([0.0, 0.0, shift])) / scale
    return points * (scale / (1 / z - shift) / z)[..., None]


@pytest.mark.parametrize("unknown", KINDS)
def test_forty_percent_outliers_and_noise_cost_less_than_a_percent(
    unknown,
):
    target = room()
    shift = {"scale": 0.0, "scale_shift": 0.4, "inverse_scale_shift": 0.05}[unknown]
    clean = relative(target, unknown, 2.5, shift)
    noise = 0.97 + 0.06 * random(ROWS, COLUMNS, seed=5)
    bad = random(ROWS, COLUMNS, seed=1) < 0.4
    source = clean * torch.where(bad, 1.3 + 2 * random(ROWS, COLUMNS, seed=2), noise)[..., None]
    found = fit_alignment(source, target, ALL, unknown)
    back = apply_alignment(clean, found)[..., 2]
    error = float((back / target[..., 2] - 1).abs().median())
    assert error < 0.01
    assert 0.5 < found.inlier_share < 0.7


@given(
    st.sampled_from(KINDS),
    st.sampled_from(["relative", "metric"]),
    st.sampled_from(["xyz", "z"]),
    st.floats(0.01, 100),
    st.floats(0, 0.9),
)
def test_any_scale_and_shift_is_recovered(unknown, residual, axes, scale, shift):
    target = room()
    if unknown == "scale":
        shift = 0.0
    elif unknown == "inverse_scale_shift":
        shift *= 1 / 6  # 1 / Z - t must stay positive up to the wall
    source = relative(target, unknown, scale, shift)
    # Depth alone does where the target's camera is not known.
    seen = target if axes == "xyz" else torch.where(torch.tensor([False, False, True]), target, 0.0)
    found = fit_alignment(
        source, seen, ALL, unknown, options=AlignmentOptions(residual=residual, axes=axes)
    )
    assert_close(apply_alignment(source, found), target, rtol=1e-5, atol=1e-6)
    assert found.scale == pytest.approx(scale, rel=1e-4)
    assert found.shift == pytest.approx(shift, abs=1e-4)
    assert found.inlier_share == 1.0
    assert found.residual < 1e-6


def test_x_and_y_tell_scale_from_shift_where_depth_is_flat():
    target = RAYS * 4.0
    source = relative(target, "scale_shift", 2.0, 1.0)
    found = fit_alignment(source, target, ALL, "scale_shift")
    assert (found.scale, found.shift) == (pytest.approx(2.0), pytest.approx(1.0))
    by_depth = fit_alignment(source, target, ALL, "scale_shift", options=DEPTH_ALONE)
    assert by_depth.inlier_share == 0.0


def test_metric_residuals_are_the_papers_least_squares():
    target = room()
    noise = 0.01 * (random(ROWS, COLUMNS, 3, seed=4) - 0.5)
    source = relative(target, "scale_shift", 2.0, 0.5) + noise
    options = AlignmentOptions(0.1, hypotheses=20, residual="metric")
    found = fit_alignment(source, target, ALL, "scale_shift", options=options)
    A = np.zeros((3 * ROWS * COLUMNS, 2))
    A[:, 0] = source.reshape(-1).numpy()
    A[2::3, 1] = 1.0
    scale, shift = np.linalg.lstsq(A, target.reshape(-1).numpy(), rcond=None)[0]
    # The robust weights are nearly flat on such noise.
    assert found.scale == pytest.approx(scale, rel=2e-4)
    assert found.shift == pytest.approx(shift, abs=2e-3)


def test_inverse_shift_keeps_each_point_on_its_ray_and_tells_infinity():
    found = Alignment(1.0, -0.1, "inverse_scale_shift", 1.0, 0.0)
    points = torch.tensor([[1, 2, 5], [1, 2, 10], [1, 2, 20]], dtype=torch.float64)
    placed = apply_alignment(points, found)
    # 1 / (1 / 5 - 0.1) = 10, on the same ray; the horizon is at 10, and beyond it there is nothing.
    assert_close(placed[0], torch.tensor([2.0, 4.0, 10.0], dtype=torch.float64))
    assert torch.isinf(placed[1:]).all()


def test_weights_decide_between_two_halves_that_disagree():
    target = room()
    source = room() / 2
    source[:, 40:] /= 1.5
    left = torch.where(torch.arange(COLUMNS) < 40, 1.0, 0.05).expand(ROWS, COLUMNS)
    first = fit_alignment(source, target, ALL, "scale", weight=left)
    second = fit_alignment(source, target, ALL, "scale", weight=left.flip(1))
    assert (first.scale, second.scale) == (pytest.approx(2.0), pytest.approx(3.0))
    assert first.inlier_share == pytest.approx(1 / 1.05, rel=0.01)
