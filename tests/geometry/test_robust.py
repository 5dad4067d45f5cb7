"""Every robust loss is x^2 near zero, and far away is what its name says."""

from __future__ import annotations

from functools import partial

import pytest
import torch

from physic_core.errors import PhysicError
from physic_core.geometry.robust import cauchy, geman_mcclure, loss_with_slope, pseudo_huber, robust_loss

LOSSES = {"geman_mcclure": geman_mcclure, "cauchy": cauchy, "pseudo_huber": pseudo_huber}


@pytest.mark.parametrize("name", LOSSES)
@pytest.mark.parametrize("c", [0.015, 1.0, 100.0])
def test_is_the_square_near_zero(name, c):
    x = torch.tensor([1e-3, -1e-3], dtype=torch.float64) * c
    torch.testing.assert_close(LOSSES[name](x**2, c=c), x**2, rtol=1e-5, atol=0)


@pytest.mark.parametrize("name", LOSSES)
def test_the_gradient_of_each_loss_is_exact(name):
    squared = torch.tensor([0.0, 1e-6, 0.3, 4.0, 900.0], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(partial(LOSSES[name], c=1.3), (squared,))


@pytest.mark.parametrize("kind", ["square", "absolute", "pseudo_huber", "cauchy", "geman_mcclure", "barron"])
@pytest.mark.parametrize("c", [0.5, 3.0])
def test_with_its_derivative_in_units_of_its_scale(kind, c):
    squared = torch.tensor([1e-6, 0.3, 4.0, 900.0], dtype=torch.float64, requires_grad=True)
    loss = robust_loss(kind, squared, c)
    (slope,) = torch.autograd.grad(loss.sum(), squared)
    unit, derivative = loss_with_slope(kind, squared.detach() / c**2, c)
    torch.testing.assert_close(c**2 * unit, loss.detach())
    torch.testing.assert_close(derivative, slope)
    assert loss_with_slope(kind, torch.zeros(1), c)[0].item() == 0
    assert torch.isfinite(loss_with_slope(kind, torch.zeros(1), c)[1])


def test_far_outliers_stop_pulling_only_where_the_loss_redescends():
    def pull(loss, x):
        x = torch.tensor(float(x), dtype=torch.float64, requires_grad=True)
        loss(x**2, c=1.0).backward()
        return x.grad.item()

    assert pull(geman_mcclure, 100) < 1e-4
    assert pull(cauchy, 100) == pytest.approx(0.02, rel=1e-3)
    assert pull(pseudo_huber, 100) == pytest.approx(2.0, rel=1e-3)


def test_settings_name_the_losses_and_barrons_keeps_its_published_height():
    squared = torch.linspace(0, 50, 40, dtype=torch.float64)
    assert robust_loss("square", squared, 3.0) is squared
    torch.testing.assert_close(robust_loss("cauchy", squared, 3.0), cauchy(squared, 3.0))
    torch.testing.assert_close(robust_loss("geman_mcclure", squared, 3.0), geman_mcclure(squared, 3.0))
    torch.testing.assert_close(robust_loss("pseudo_huber", squared, 3.0), pseudo_huber(squared, 3.0))
    torch.testing.assert_close(robust_loss("barron", squared, 3.0), torch.sqrt(1 + squared / 9) - 1)
    with pytest.raises(PhysicError, match=r"^unknown robust loss 'huber': use square, absolute, barron, cauchy"):
        robust_loss("huber", squared, 1.0)
