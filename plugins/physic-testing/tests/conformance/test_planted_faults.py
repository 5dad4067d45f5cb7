"""Faults of wrappers are found, in perfect networks and in real ones, and backends without a fault
pass.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from faults import FORTY, FOUND_BY, FURTHER
from stand_ins import run_checks

from physic_testing.conformance.kit import accuracy_checks
from physic_testing.conformance.report import Result
from physic_testing.conformance.run import CheckRun

Fault = tuple[str, str, Callable[..., Any]]
ALL = [(mock, fault) for mock in FORTY for fault in (*FORTY[mock], *FURTHER[mock])]
SEEDS = (1000, 1001)
UNSEEN = {
    ("MockInpainter", "one pixel down"),
    ("MockMetricDepth", "one pixel to the right"),
    ("MockKeypointDetector", "clipped"),
    ("MockKeypointDetector", "corner of the cell"),
    ("MockBodyEstimator", "Euler angles"),
    ("MockHandEstimator", "thumb first"),
    ("MockContactPrior", "mirrored"),
}
"""Faults that are lost among errors as large as those of a network."""
NOISY = [
    (mock, fault)
    for mock, faults in FORTY.items()
    for fault in faults
    if (mock, fault[0]) not in UNSEEN
]


def name_of(value: Any) -> str:
    return value.removeprefix("Mock") if isinstance(value, str) else value[0].replace(" ", "_")


def failures(run: CheckRun) -> Iterator[Result]:
    """The failures and warnings; a check runs when its result is asked for."""
    names = [
        "returns_valid_output",
        *(check.name for check in accuracy_checks(run.subject.interface)),
    ]
    return (found for name in names if (found := run.result(name)).outcome in ("failed", "warned"))


@pytest.mark.parametrize(("mock", "fault"), ALL, ids=name_of)
def test_a_fault_is_found_and_named_in_a_perfect_network(mock: str, fault: Fault):
    words, hint, change = fault
    named = (
        failure.check
        for failure in failures(run_checks(mock, change))
        if re.search(hint, failure.message)
    )
    first = next(named, None)
    assert first is not None
    assert first == FOUND_BY.get((mock, words), first)


@pytest.mark.slow
@pytest.mark.parametrize(("mock", "fault"), NOISY, ids=name_of)
def test_a_fault_is_found_among_the_errors_of_a_network(mock: str, fault: Fault):
    assert any(failures(run_checks(mock, fault[2], noise=1, seed=1000)))


@pytest.mark.parametrize("mock", FORTY)
@pytest.mark.parametrize("noise", [0, 1])
def test_a_mock_without_a_fault_passes(mock: str, noise: int):
    for seed in SEEDS if noise else (0,):
        assert list(failures(run_checks(mock, noise=noise, seed=seed))) == []


@pytest.mark.parametrize(
    "fault", [*FORTY["MockHandEstimator"], *FURTHER["MockHandEstimator"]], ids=name_of
)
def test_faults_of_hands_are_found_in_backends_that_see_no_small_hand(fault: Fault):
    """As networks do that leave hands below 32 px, those of a person of 400 px, as they are."""

    def change(hands: Any, image: Any, people: Any, *rest: Any) -> Any:
        is_large = people.boxes[:, 3] - people.boxes[:, 1] >= 400
        found = fault[2](hands, image, people, *rest)
        return replace(found, confidence=np.where(is_large[:, None], found.confidence, 0))

    assert any(failures(run_checks("MockHandEstimator", change)))
