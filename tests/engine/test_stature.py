"""People as a ruler: stature against the scene's scale, as two measurements are weighed."""

from __future__ import annotations

import math

import pytest
import torch

from physic_core.engine.presets import PRESETS
from physic_core.engine.scene.stature import linearise_stature, stature_prior

JOINT = PRESETS["default"].joint


@pytest.fixture(scope="module")
def standing(make_stage):
    return make_stage([({}, (0.0, 0.0, 3.5))])


def test_stature_is_linear_in_shape(body):
    betas = torch.zeros(1, body.num_betas)
    stature = linearise_stature(body, betas)
    for seed in range(5):
        other = 0.7 * torch.randn(1, body.num_betas, generator=torch.Generator().manual_seed(seed))
        assert stature(other).item() == pytest.approx(body.stature(other).item(), abs=3e-3)


def test_gradient(body):
    model = body.to(dtype=torch.float64)
    stature = linearise_stature(model, torch.zeros(2, body.num_betas, dtype=torch.float64))
    betas = (
        0.3
        * torch.randn(
            2, body.num_betas, generator=torch.Generator().manual_seed(0), dtype=torch.float64
        ).requires_grad_()
    )
    expected = torch.tensor([1.7, 1.6], dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda b: stature_prior(stature(b), expected, 0.04), betas)


def test_by_hand():
    value = stature_prior(torch.tensor([1.6 * math.exp(0.08)]), torch.tensor([1.6]), 0.04)
    assert value.item() == pytest.approx(4.0, rel=1e-5)


def spread_of_stature(body):
    """Standard deviation of log(stature) that the shape prior of weight 1 stands for: the whitened shape is normal."""
    betas = torch.zeros(1, body.num_betas)
    stature = linearise_stature(body, betas)
    return 0.5 * (stature.slope / stature.height[:, None]).norm().item()


def test_the_shape_prior_alone_knows_stature_to_five_percent(body):
    assert spread_of_stature(body) == pytest.approx(0.054, abs=0.003)
