"""Checks say which person is doubtful, and warnings which result."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from physic_core.checks import CHECKS, failed_checks, warnings_of


def case(told: dict[str, Any], failure: str = "", legs: bool = True, sigma: float = 0.1, scale: float = 1.0) -> Any:
    observed = np.ones((1, 55), bool)
    observed[0, [4, 7]] = legs
    return (
        SimpleNamespace(bodies=SimpleNamespace(observed=observed), depth=SimpleNamespace(scale_sigma=sigma)),
        SimpleNamespace(people=(told,), failures=(failure,), scene=SimpleNamespace(scale=scale)),
    )


@pytest.mark.parametrize(
    ("told", "options", "failed"),
    [
        ({}, {}, ()),
        ({"reprojection_share": 0.01, "penetration_share": 0.02, "floating_m": 0.01}, {}, ()),
        ({"reprojection_share": 0.05}, {}, ("reprojection",)),
        ({"penetration_share": 0.2}, {}, ("penetration",)),
        ({"floating_m": 0.2}, {}, ("grounded",)),
        ({"floating_m": None}, {}, ()),
        ({"floating_m": 0.2}, {"legs": False}, ("legs seen",)),
        ({}, {"failure": "no start"}, ("optimised",)),
        ({"reprojection_share": 0.05, "floating_m": 0.2}, {}, ("reprojection", "grounded")),
    ],
)
def test_failed_checks(told: dict[str, Any], options: dict[str, Any], failed: tuple[str, ...]) -> None:
    assert failed_checks(*case(told, **options), 0) == failed
    assert set(failed) <= set(CHECKS)


def test_one_seen_ankle_is_enough_of_a_leg() -> None:
    evidence, solution = case({}, legs=False)
    evidence.bodies.observed[0, 7] = True
    assert failed_checks(evidence, solution, 0) == ()


def test_a_backend_that_does_not_say_what_is_seen_is_believed() -> None:
    evidence, solution = case({}, legs=False)
    evidence.bodies.observed = None
    assert failed_checks(evidence, solution, 0) == ()


def test_warnings() -> None:
    assert warnings_of(*case({})) == ()
    assert warnings_of(*case({}, failure="the start is not made of numbers")) == (
        "person 0 stays where the placement left them: the start is not made of numbers",
    )
    assert warnings_of(*case({}, sigma=0.22)) == (
        "all lengths may be off by 22% (one standard deviation): the photo gives no better scale",
    )
    assert warnings_of(*case({}, scale=1.4)) == (
        "the people and the metric depth disagree: the scene was rescaled by 1.40",
    )
