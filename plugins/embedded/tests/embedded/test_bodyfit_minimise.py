from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
import torch
from torch import Tensor

import physic_embedded.body_fit.fit as fit_module
from physic_core.types import Hints, Observations
from physic_core.types.observations import POSTURES
from physic_embedded.body_fit.derivatives import derivatives, loss_and_gradient
from physic_embedded.body_fit.minimise import approach_minimum, covariance, minimise

from .test_bodies import (
    CAMERA,
    FLOOR,
    IMAGE,
    PLACES,
    SITS,
    WALKS,
    loaded,
    truth,
    with_keypoints,
)
from .test_outlines import depth_of, silhouette, with_masks


def valley_loss(x, a):
    """Rosenbrock's function of pairs of unknowns, with its minimum at (a, a^2)."""
    return (a - x[:, 0]).square() + 100 * (x[:, 1] - x[:, 0].square()).square()


@dataclass(frozen=True)
class Valley:
    """A function of unknowns (N, W) with a number ``a`` for each person."""

    a: Tensor
    function: Callable[[Tensor, Tensor], Tensor] = valley_loss
    asked: list[int] = field(default_factory=list)

    def select(self, rows):
        return replace(self, a=self.a[rows])

    def loss(self, x):
        self.asked.append(len(x))
        return self.function(x, self.a)


def differences(problem, unknowns, step=1e-5):
    """Hessian (N, W, W) by differences of gradients."""
    count, width = unknowns.shape
    at = unknowns[:, None] + step * torch.eye(width, dtype=unknowns.dtype)
    rows = torch.arange(count).repeat_interleave(width)
    _, moved = loss_and_gradient(problem.select(rows), at.flatten(0, 1))
    _, gradient = loss_and_gradient(problem, unknowns)
    return (moved.view(count, width, width) - gradient[:, None]) / step


def by_differences(problem, unknowns):
    return *loss_and_gradient(problem, unknowns), differences(problem, unknowns)


def doubles(*values):
    return torch.tensor(values, dtype=torch.float64)


def minimum(problem, start):
    return minimise(problem, start, by_differences)


def test_people_end_at_their_own_minima_and_stop_one_by_one():
    problem = Valley(doubles(1.0, -0.5, 2.0))
    start = doubles([-1.2, 1.0], [0.0, 0.0], [2.0, 4.0])
    found = minimum(problem, start)
    wanted = torch.stack([problem.a, problem.a.square()], 1)
    torch.testing.assert_close(found, wanted, rtol=0, atol=1e-9)
    assert start[1].tolist() == [0.0, 0.0]
    assert problem.asked[-1] == 1  # of the last step of the first person alone


def test_the_way_of_a_person_is_the_same_beside_others():
    start = doubles([-1.2, 1.0], [30.0, -20.0], [2.0, 4.0])
    values = doubles(1.0, -0.5, 2.0)
    together = approach_minimum(Valley(values), start, 25)
    for row in range(3):
        alone = approach_minimum(Valley(values[[row]]), start[[row]], 25)
        torch.testing.assert_close(together[[row]], alone, rtol=0, atol=1e-9)
    assert (valley_loss(together, values) <= 0.1 * valley_loss(start, values)).all()


def test_a_saddle_is_left_downhill():
    saddle = Valley(doubles(1.0), lambda x, a: (x[:, 0].square() - a).square() + x[:, 1].square())
    found = minimum(saddle, doubles([0.1, 0.5]))
    assert found[0].tolist() == pytest.approx([1.0, 0.0], abs=1e-9)


def test_the_covariance_is_that_of_a_linear_problem():
    generator = torch.Generator().manual_seed(0)
    design = torch.randn(7, 2, dtype=torch.float64, generator=generator)
    problem = Valley(doubles(1.0), lambda x, a: (x @ design.T - a[:, None]).square().sum(1))
    found = covariance(problem, doubles([0.0, 0.0]), by_differences)
    torch.testing.assert_close(found[0], torch.linalg.inv(design.T @ design), rtol=1e-6, atol=0)


def test_no_person_moves_where_the_loss_is_nan():
    def broken(x, a):
        return torch.where(x[:, 0] > 0.5, torch.nan, valley_loss(x, a))

    start = doubles([0.5, 0.25])
    problem = Valley(doubles(1.0), broken)
    assert problem.loss(minimum(problem, start)) <= problem.loss(start)


@pytest.mark.parametrize("landmarks", [False, True])
def test_the_hessian_of_the_fit_is_that_of_differences(landmarks, monkeypatch):
    """Of two people with all terms: floor, feet, legs, heads, outlines, limbs."""
    seen = truth([WALKS, SITS], PLACES[:2], noise_px=3.0)
    seen = with_masks(seen, *(silhouette(body) for body in seen.vertices))
    if not landmarks:
        seen = with_keypoints(seen, world=None)
    said = replace(
        Observations.unknown(2),
        posture=np.tile(0.01 + 0.91 * (np.array(POSTURES) == "sit"), (2, 1)),
        head=np.float32([[0.6, 0.0, -0.8], [0.0, 0.6, -0.8]]),
        head_sigma=np.float32([6, 12]),
    )
    solved = []
    monkeypatch.setattr(
        fit_module, "minimise", lambda *given, **_: solved.append(given) or given[1]
    )
    hints = Hints(floor=FLOOR, observations=said, original=depth_of(seen))
    loaded().infer(IMAGE, seen.people, CAMERA, seen.keypoints, hints)
    problem, _ = solved[-1]
    generator = torch.Generator().manual_seed(0)
    at = 0.5 * torch.randn(2, problem.num_unknowns, dtype=torch.float64, generator=generator)
    loss, gradient, hessian = derivatives(problem, at)
    wanted = loss_and_gradient(problem, at)
    torch.testing.assert_close(loss, wanted[0], rtol=1e-12, atol=0)
    torch.testing.assert_close(gradient, wanted[1], rtol=1e-9, atol=1e-9)
    wanted_hessian = differences(problem, at)
    assert (hessian - wanted_hessian).abs().max() < 1e-4 * wanted_hessian.abs().max()
