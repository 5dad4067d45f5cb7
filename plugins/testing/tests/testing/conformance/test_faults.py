"""Each fault of a wrapper is found by the check for it, and backends without a fault pass."""

from __future__ import annotations

import pytest
from faults import FAULTS, RIGHT
from stand_ins import SIZE, RightDepth, checks_of, stand_in, subject_of
from wrong_backends import WRONG

from physic_core.interfaces import INTERFACES
from physic_mock import backends as mocks
from physic_testing.conformance import checks_for
from physic_testing.conformance.backend_under_test import find_backend
from physic_testing.conformance.cases import SIZE as STANDARD_SIZE
from physic_testing.conformance.kit import accuracy_checks, start_checks
from physic_testing.conformance.tables import TABLES

FAILED = ("failed", "warned")
SEEDS = (1000, 1001)


def rows_of(table):
    return [(mock, words) for mock, rows in table.items() for words in rows]


def name_of(value):
    return value.removeprefix("Mock").replace(" ", "_")


@pytest.mark.parametrize(
    ("mock", "form"), [*((mock, "") for mock in mocks.__all__), *rows_of(RIGHT)], ids=name_of
)
def test_a_right_backend_passes_every_check_that_can_be_judged(mock, form):
    change = RIGHT[mock][form] if form else None
    report = start_checks(subject_of(stand_in(mock, change))).report()
    assert report.ok, report.text
    left_out = {r.check for r in report.results if r.outcome == "skipped"}
    assert left_out <= {
        "registration_is_light",
        "ignores_the_image",
        "default_weights_are_listed",
        "is_exact",
        "leaves_home_and_network_alone",
        *["world_points_are_metres"] * (mock == "MockKeypointDetector" and not form),
        *["wrists_are_in_the_cameras_frame"] * (mock == "MockHandEstimator" and not form),
    }


@pytest.mark.parametrize(("mock", "fault"), rows_of(FAULTS), ids=name_of)
def test_a_fault_is_found_by_its_check(mock, fault):
    check, change = FAULTS[mock][fault]
    failure = checks_of(mock, change).result(check)
    assert failure.outcome in FAILED, failure
    assert failure.expected
    assert failure.got


@pytest.mark.parametrize("mistake", WRONG)
def test_a_wrong_class_is_caught_by_its_check(mistake, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    kind, check = WRONG[mistake]
    run = start_checks(find_backend(kind, None, size=SIZE))
    failure = run.result(check)
    run.subject.close()
    assert failure.outcome in FAILED, failure


def test_a_right_backend_that_must_be_loaded_passes():
    assert start_checks(find_backend(RightDepth, None, size=SIZE)).report().ok


def test_every_check_of_all_interfaces_catches_a_fault():
    every = {check.name for interface in INTERFACES for check in checks_for(interface)}
    checks = {check for rows in FAULTS.values() for check, _ in rows.values()}
    checks |= {check for _, check in WRONG.values()}
    checks |= {group.check for table in TABLES.values() for group in table.groups}
    assert every == checks | {"default_weights_are_listed", "registration_is_light"}


def test_rows_that_all_change_fail_and_some_only_warn():
    for fault, outcome in (
        ("normalized over people", "failed"),
        ("lower for all but the first", "warned"),
    ):
        check, change = FAULTS["MockContactPrior"][fault]
        assert checks_of("MockContactPrior", change).result(check).outcome == outcome


def failures(run):
    """The failures and warnings; a check runs when its result is asked for."""
    names = [
        "returns_valid_output",
        "accepts_photos_of_people",
        *(check.name for check in accuracy_checks(run.subject.interface)),
    ]
    return (result for name in names if (result := run.result(name)).outcome in FAILED)


@pytest.mark.slow
@pytest.mark.parametrize("mock", mocks.__all__)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_network_without_a_fault_passes(mock, seed):
    assert list(failures(checks_of(mock, noise=1, seed=seed, size=STANDARD_SIZE))) == []
