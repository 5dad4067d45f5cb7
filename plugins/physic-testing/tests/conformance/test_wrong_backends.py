"""The table of wrong backends x checks: each is caught by its own check and by no other."""

from __future__ import annotations

import ast
import inspect
import pydoc
from collections import Counter
from pathlib import Path

import pytest
import wrong_bodies
from planted_faults import FAULTS, READER_FAULTS
from right_backends import RIGHT, SIZE
from table import row, table
from wrong_backends import WRONG, Wrong

from physic_core import interfaces
from physic_core.interfaces import INTERFACES
from physic_mock import backends as mocks
from physic_testing import check_backend, conformance
from physic_testing.conformance import checks_for


@pytest.mark.parametrize("kind", [*RIGHT, *wrong_bodies.RIGHT], ids=lambda kind: kind.__name__)
def test_a_right_backend_passes_every_check_that_can_be_judged(kind: type[interfaces.Backend]):
    report = check_backend(kind, size=SIZE)
    assert report.ok, report.text
    left_out = {r.check for r in report.results if r.outcome == "skipped"}
    assert left_out <= {
        "registration_is_light",
        "returns_intrinsics_as_promised",
        "ignores_the_image",
        "is_exact",
    }


@pytest.mark.parametrize("mistake", WRONG, ids=lambda mistake: mistake.id)
def test_a_wrong_backend_is_caught_by_its_own_check_and_by_no_other(mistake: Wrong):
    report = row(mistake)
    assert [failure.check for failure in report.failures] == [mistake.check], report.text
    (failure,) = report.failures
    assert failure.expected
    assert failure.got
    assert not report.ok


@pytest.mark.parametrize("interface", INTERFACES)
def test_every_check_catches_somebody(interface: str):
    own = {check.name for check in checks_for(interface)}
    common = set.intersection(*({check.name for check in checks_for(other)} for other in INTERFACES))
    planted = {f.check for f in FAULTS + READER_FAULTS if getattr(mocks, f.mock).interface == interface}
    caught = {m.check for m in WRONG if m.kind.interface == interface} | planted
    everywhere = {m.check for m in WRONG}
    assert own & common <= everywhere
    # Checks that several interfaces share without any difference need one wrong backend only.
    assert own - common - caught <= {"works_without_hints", "accepts_a_photo_without_people", "rows_follow_the_people"}


def test_every_mistake_has_a_name_of_its_own():
    assert [name for name, count in Counter(m.id for m in WRONG).items() if count > 1] == []


def test_the_table_shows_one_cross_a_row():
    text = table(WRONG[:3])
    head, rule, *rows = text.splitlines()
    assert head.startswith("| interface | wrong backend |")
    assert set(rule) == set("|-")
    assert [line.count("caught") for line in rows] == [1, 1, 1]


@pytest.mark.parametrize("interface", INTERFACES)
def test_every_conformance_check_has_a_question_and_a_reference(interface: str):
    for check in checks_for(interface):
        assert check.summary.endswith((".", ":")), check.name
        assert pydoc.locate(check.read) is not None, f"{check.name}: there is no {check.read}"


@pytest.mark.parametrize("interface", INTERFACES)
def test_a_check_builds_only_on_checks_before_it(interface: str):
    seen: set[str] = set()
    for check in checks_for(interface):
        assert check.name not in seen, f"{check.name} comes twice"
        assert set(check.after) <= seen | {"is_deterministic", "keeps_no_state_between_photos"}, check.name
        seen.add(check.name)


def test_no_check_fails_without_a_message():
    """A bare assert would say nothing to an author."""
    for path in Path(inspect.getfile(conformance)).parent.glob("*.py"):
        bare = [n.lineno for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Assert) and n.msg is None]
        assert bare == [], f"{path.name}: lines {bare}"
