"""``benchmarks/exports_opened``: files of a result agree with it, and what is not so is said."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks import exports_opened
from benchmarks.export_readers import Opened
from benchmarks.exports_opened import READERS, Outcome, is_wrong, outcome_of, row_of
from physic_core import find_exporters


@pytest.mark.parametrize("form", ["keypoints", "depth"])
def test_a_file_opens_with_all_people_and_agrees_with_the_result(form, saved_pair):
    outcome = outcome_of(form, str(saved_pair))
    assert not outcome.fault
    assert not is_wrong(form, outcome)
    assert "| 1 of 1 |" in row_of(form, [outcome])


@pytest.mark.parametrize(
    ("read", "said"),
    [
        (lambda files: Opened(1, 0.0), "1 of 2 people"),
        (lambda files: [][0], "IndexError"),
    ],
)
def test_a_missing_person_or_an_error_of_the_reader_is_no_opened_file(
    read, said, saved_pair, monkeypatch
):
    monkeypatch.setitem(READERS, "keypoints", replace(READERS["keypoints"], read=read))
    outcome = outcome_of("keypoints", str(saved_pair))
    assert said in outcome.fault
    assert is_wrong("keypoints", outcome)
    assert "| 0 of 1 |" in row_of("keypoints", [outcome])


def test_a_format_that_refuses_a_result_is_neither_opened_nor_wrong(saved_pair):
    outcome = outcome_of("amass", str(saved_pair))
    assert "SMPL-X" in outcome.refused
    assert not is_wrong("amass", outcome)
    assert "| 0 of 0 | 1 |" in row_of("amass", [outcome])


def test_a_difference_above_the_limit_of_the_row_is_wrong():
    limit = READERS["depth"].limit
    assert not is_wrong("depth", Outcome(limit))
    assert is_wrong("depth", Outcome(2 * limit))


def test_a_reader_that_is_not_installed_opens_nothing(saved_pair, monkeypatch, capsys):
    absent = replace(READERS["depth"], distribution="no-such-reader", module="no_such_reader")
    monkeypatch.setitem(READERS, "depth", absent)
    monkeypatch.setattr("sys.argv", ["", str(saved_pair), "--format", "depth"])
    assert exports_opened.main() == 1
    assert "not opened: pip install no-such-reader" in capsys.readouterr().out


def test_each_format_of_the_project_has_a_reader():
    assert set(READERS) == {one.record.name for one in find_exporters()}
