"""Each wrong backend is caught by the check of its mistake, and right ones pass all checks."""

from __future__ import annotations

import pytest
import wrong_bodies
from faults import FOUND_BY
from right_backends import RIGHT, SIZE, RightKeypoints, RightObserver
from wrong_backends import WRONG

from physic_core.interfaces import INTERFACES
from physic_testing import check_backend
from physic_testing.conformance import checks_for
from physic_testing.conformance.backend_under_test import find_backend
from physic_testing.conformance.kit import start_checks


@pytest.mark.parametrize("kind", [*RIGHT, *wrong_bodies.RIGHT], ids=lambda kind: kind.__name__)
def test_a_right_backend_passes_every_check_that_can_be_judged(kind):
    report = check_backend(kind, size=SIZE)
    assert report.ok, report.text
    left_out = {r.check for r in report.results if r.outcome == "skipped"}
    assert left_out <= {
        "registration_is_light",
        "ignores_the_image",
        "default_weights_are_listed",
        "is_exact",
        *["world_points_are_metres"] * (kind is RightKeypoints),
        *["mirrored_photo_exchanges_sides"] * (kind is RightObserver),  # both sides touch alike
    }


def start(mistake):
    return start_checks(find_backend(mistake.kind, None, size=SIZE))


@pytest.mark.parametrize("mistake", WRONG, ids=lambda mistake: mistake.id)
def test_a_wrong_backend_is_caught_by_its_own_check(mistake, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = start(mistake)
    failure = run.result(mistake.check)
    run.subject.close()
    assert failure.outcome in ("failed", "warned"), failure
    assert failure.expected
    assert failure.got


def test_every_check_of_all_interfaces_catches_a_wrong_backend():
    every = {check.name for interface in INTERFACES for check in checks_for(interface)}
    found = {mistake.check for mistake in WRONG}.union(*map(dict.values, FOUND_BY.values()))
    of_plugins = {"default_weights_are_listed", "registration_is_light"}
    assert every == found | of_plugins


def test_rows_that_all_change_fail_and_some_only_warn():
    mistakes = {one.mistake: one for one in WRONG}
    for name, outcome in (
        ("normalised over people", "failed"),
        ("coarser for all but the first", "warned"),
    ):
        run = start(mistakes[name])
        assert run.result("rows_do_not_depend_on_other_people").outcome == outcome
