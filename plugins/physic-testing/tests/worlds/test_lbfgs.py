"""Minima of a bowl, of a bent valley and of a function with kinks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import rosen, rosen_der

from physic_testing.worlds.lbfgs import minimize


def test_a_bowl_ends_at_its_bottom() -> None:
    scale = np.geomspace(1, 1e4, 30)
    bottom = np.linspace(-1, 1, 30)

    def bowl(x: np.ndarray) -> tuple[float, np.ndarray]:
        return float((scale * (x - bottom) ** 2).sum()), 2 * scale * (x - bottom)

    assert minimize(bowl, np.zeros(30), 300) == pytest.approx(bottom, abs=2e-3)
    assert np.array_equal(minimize(bowl, bottom, 300), bottom)


def test_a_bent_valley_is_followed() -> None:
    found = minimize(lambda x: (float(rosen(x)), rosen_der(x)), np.full(6, -1.2), 300)
    assert rosen(found) < 1e-6


def test_kinks_do_not_stop_it_early() -> None:
    def kinked(x: np.ndarray) -> tuple[float, np.ndarray]:
        return float(abs(x[0]) + 5 * abs(x[1] - x[0]) + x[1] ** 2), np.array(
            [np.sign(x[0]) - 5 * np.sign(x[1] - x[0]), 5 * np.sign(x[1] - x[0]) + 2 * x[1]]
        )

    assert kinked(minimize(kinked, np.array([3.0, -2.0]), 200))[0] < 1e-3


def test_no_more_steps_are_taken_than_allowed() -> None:
    seen = []

    def bowl(x: np.ndarray) -> tuple[float, np.ndarray]:
        seen.append(x)
        return float((x * x).sum()), 2 * x

    start = np.full(3, 8.0)
    assert np.array_equal(minimize(bowl, start, 0), start)
    assert len(seen) == 1
