"""Every robust loss is x^2 near zero, and far away is what its name says."""

from __future__ import annotations

import pytest
import torch
from torch.testing import assert_close

from physic_core.errors import PhysicError
from physic_core.geometry.robust import loss_with_slope, robust_loss

pytestmark = pytest.mark.quick

LOSSES = ("geman_mcclure", "cauchy", "pseudo_huber")


@pytest.mark.parametrize("kind", ["square", "absolute", "barron", *LOSSES])
def test_the_slope_is_exact_also_in_units_of_the_scale(kind):
    c = 3.0
    squared = torch.tensor([1e-6, 0.3, 4.0, 900.0], dtype=torch.float64, requires_grad=True)
    loss = robust_loss(kind, squared, c)
    (slope,) = torch.autograd.grad(loss.sum(), squared)
    unit, derivative = loss_with_slope(kind, squared.detach() / c**2, c)
    assert_close(c**2 * unit, loss.detach())
    assert_close(derivative, slope)
    assert loss_with_slope(kind, torch.zeros(1), c)[0].item() == 0
    assert torch.isfinite(loss_with_slope(kind, torch.zeros(1), c)[1])


@pytest.mark.parametrize(
    ("kind", "height"),
    [
        ("geman_mcclure", lambda q: 9 * q / (1 + q)),
        ("cauchy", lambda q: 9 * torch.log(1 + q)),
        ("pseudo_huber", lambda q: 18 * (torch.sqrt(1 + q) - 1)),
        ("barron", lambda q: torch.sqrt(1 + q) - 1),
    ],
)
def test_a_loss_has_its_published_height(kind, height):
    squared = torch.linspace(0, 50, 40, dtype=torch.float64)
    assert_close(robust_loss(kind, squared, 3.0), height(squared / 9))


def test_a_loss_of_another_name_is_refused():
    squared = torch.ones(1)
    with pytest.raises(PhysicError, match="unknown robust loss 'huber'"):
        robust_loss("huber", squared, 1.0)
