"""Faults of wrappers are found, in perfect networks and in real ones, and backends without a fault
pass.
"""

from __future__ import annotations

import pytest
from faults import FOUND_BY, FURTHER, NOISY
from stand_ins import run_checks

from physic_testing.conformance.kit import accuracy_checks

pytestmark = pytest.mark.slow

SEEDS = (1000, 1001)
LOST = {("MockInpainter", "faded")}
"""It looks like a right fill."""
UNSEEN = {
    ("MockMetricDepth", "along the ray"),
    ("MockKeypointDetector", "half a pixel off"),
    ("MockBodyEstimator", "seen by the camera of a crop"),
    ("MockContactPrior", "mirrored"),
}
"""Faults that are lost among errors as large as those of a network."""
FAULTS = {mock: NOISY[mock] | FURTHER[mock] for mock in NOISY}


def found_of(faults, lost):
    """Mock and fault for each fault that is not lost."""
    pairs = [(mock, fault) for mock, changes in faults.items() for fault in changes]
    return [pair for pair in pairs if pair not in lost]


def name_of(value):
    return value.removeprefix("Mock").replace(" ", "_")


def failures(run):
    """The failures and warnings; a check runs when its result is asked for."""
    names = [
        "returns_valid_output",
        "accepts_photos_of_people",
        *(check.name for check in accuracy_checks(run.subject.interface)),
    ]
    return (found for name in names if (found := run.result(name)).outcome in ("failed", "warned"))


@pytest.mark.parametrize(("mock", "fault"), found_of(FAULTS, LOST), ids=name_of)
def test_a_fault_is_found_in_a_perfect_network(mock, fault):
    run = run_checks(mock, FAULTS[mock][fault])
    if check := FOUND_BY[mock].get(fault):
        assert run.result(check).outcome in ("failed", "warned")
    else:
        assert any(failures(run))


@pytest.mark.parametrize(("mock", "fault"), found_of(NOISY, UNSEEN), ids=name_of)
def test_a_fault_is_found_among_the_errors_of_a_network(mock, fault):
    assert any(failures(run_checks(mock, NOISY[mock][fault], noise=1, seed=1000)))


@pytest.mark.parametrize("mock", NOISY)
@pytest.mark.parametrize("noise", [0, 1])
def test_a_mock_without_a_fault_passes(mock, noise):
    for seed in SEEDS if noise else (0,):
        assert list(failures(run_checks(mock, noise=noise, seed=seed))) == []
