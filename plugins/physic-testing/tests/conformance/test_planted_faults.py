"""Faults in noise-free mocks are found, and mocks without a fault pass, with errors and without."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from planted_faults import FAULTS, READER_FAULTS, Fault, run_checks

from physic_core.interfaces import INTERFACES
from physic_testing import check_backend
from physic_testing.conformance.kit import accuracy_checks


def failures(fault: Fault | str) -> list[str]:
    run = run_checks(fault)
    names = ["returns_valid_output", *(check.name for check in accuracy_checks(run.subject.interface))]
    return [name for name in names if name != "is_exact" and run.result(name).outcome == "failed"]


@pytest.mark.parametrize("fault", FAULTS + READER_FAULTS, ids=lambda fault: fault.id)
def test_a_planted_fault_is_found_by_its_own_check(fault: Fault):
    assert failures(fault) == ([fault.check] if fault.check else [])


@pytest.mark.parametrize("fault", [fault for fault in FAULTS if fault.mock == "MockHandEstimator"], ids=lambda f: f.id)
def test_faults_of_hands_are_found_in_backends_that_see_no_small_hand(fault: Fault):
    """As networks do that leave hands below 32 px, those of a person of 400 px, as they are."""

    def change(hands: Any, image: Any, people: Any, *rest: Any) -> Any:
        is_large = people.boxes[:, 3] - people.boxes[:, 1] >= 400
        found = fault.change(hands, image, people, *rest)
        return replace(found, confidence=np.where(is_large[:, None], found.confidence, 0))

    assert failures(replace(fault, change=change)) == [fault.check]


@pytest.mark.parametrize("mock", sorted({fault.mock for fault in FAULTS}))
def test_a_mock_without_a_fault_passes(mock: str):
    assert failures(mock) == []


@pytest.mark.parametrize("interface", INTERFACES)
def test_errors_as_large_as_those_of_networks_are_no_bias(interface: str):
    report = check_backend("mock", interface, options={"noise": 1, "noise_seed": 1000})
    assert report.ok, report.text
