from __future__ import annotations

from dataclasses import dataclass, replace

import pytest
import torch
from torch import Tensor

from physic_embedded.body_fit.newton import covariance, minimize_newton


@dataclass(frozen=True)
class Valley:
    """Rosenbrock's function of pairs of unknowns, its minimum (a, a^2) different for each
    person.
    """

    a: Tensor
    asked: list[int]

    def select(self, rows: Tensor) -> Valley:
        return replace(self, a=self.a[rows])

    def loss(self, x: Tensor) -> Tensor:
        self.asked.append(len(x))
        return (self.a - x[:, 0]).square() + 100 * (x[:, 1] - x[:, 0].square()).square()


def valley(*a):
    return Valley(torch.tensor(a, dtype=torch.float64), [])


def test_each_person_ends_at_their_minimum():
    problem = valley(1.0, -0.5, 2.0)
    start = torch.tensor([[-1.2, 1.0], [0.0, 0.0], [2.0, 4.0]], dtype=torch.float64)
    found = minimize_newton(problem, start)
    torch.testing.assert_close(found[:, 0], problem.a, rtol=0, atol=1e-9)
    torch.testing.assert_close(found[:, 1], problem.a.square(), rtol=0, atol=1e-9)
    assert start[1].tolist() == [0.0, 0.0]


def test_people_are_independent_and_stop_one_by_one():
    starts = torch.tensor([[-1.2, 1.0], [2.0, 4.0]], dtype=torch.float64)
    problem = valley(1.0, 2.0)
    together = minimize_newton(problem, starts)
    assert problem.asked[0] == 2 * 3
    assert problem.asked[-1] == 1  # of the last step of the first person alone
    for i in range(2):
        alone = minimize_newton(valley(float(problem.a[i])), starts[i : i + 1])
        torch.testing.assert_close(together[i], alone[0], rtol=0, atol=1e-9)


def test_a_saddle_is_left_downhill():
    class Saddle(Valley):
        def loss(self, x: Tensor) -> Tensor:
            return (x[:, 0].square() - 1).square() + x[:, 1].square()

    found = minimize_newton(
        Saddle(torch.zeros(1), []), torch.tensor([[0.1, 0.5]], dtype=torch.float64)
    )
    assert found[0].tolist() == pytest.approx([1.0, 0.0], abs=1e-9)


def test_the_covariance_is_that_of_a_linear_problem():
    generator = torch.Generator().manual_seed(0)
    design = torch.randn(7, 2, dtype=torch.float64, generator=generator)

    class Linear(Valley):
        def loss(self, x: Tensor) -> Tensor:
            return (x @ design.T - 1).square().sum(1)

    problem = Linear(torch.zeros(1, dtype=torch.float64), [])
    found = covariance(problem, torch.zeros(1, 2, dtype=torch.float64))
    torch.testing.assert_close(found[0], torch.linalg.inv(design.T @ design), rtol=1e-6, atol=0)


def test_no_person_moves_where_the_loss_is_nan():
    class Broken(Valley):
        def loss(self, x: Tensor) -> Tensor:
            return torch.where(x[:, 0] > 0.5, torch.nan, super().loss(x))

    start = torch.tensor([[0.5, 0.25]], dtype=torch.float64)
    problem = Broken(torch.ones(1, dtype=torch.float64), [])
    before = problem.loss(start)
    after = problem.loss(minimize_newton(problem, start))
    assert after <= before
