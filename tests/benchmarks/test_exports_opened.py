"""``benchmarks/exports_opened``: files of a result agree with it, what is not so is said, and the
table benchmarks/exports_opened.csv is what the programs read.
"""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.export_readers import Opened
from benchmarks.exports_opened import READERS, Reader, is_wrong, outcome_of, outcomes_of

ALL = Reader("keypoints", "", "csv", lambda files: Opened(len(files.bodies)), "people", 0.1)
"""Finds everybody."""
with (Path(__file__).parents[2] / "benchmarks" / "exports_opened.csv").open(newline="") as file:
    ROWS = {(cells[0], cells[1].split(" ")[0]): cells for cells in csv.reader(file)}


def test_a_file_opens_with_all_people_and_agrees_with_the_result(saved_pair):
    outcome = outcome_of(ALL, str(saved_pair))
    assert not outcome.fault
    assert not is_wrong(ALL, outcome)


@pytest.mark.parametrize(
    ("read", "said"),
    [
        (lambda files: Opened(1, 0.0), "1 of 2 people"),
        (lambda files: [][0], "IndexError"),
    ],
)
def test_a_missing_person_or_an_error_of_the_reader_is_no_opened_file(read, said, saved_pair):
    reader = replace(ALL, read=read)
    outcome = outcome_of(reader, str(saved_pair))
    assert said in outcome.fault
    assert is_wrong(reader, outcome)


def test_a_format_that_refuses_a_result_is_neither_opened_nor_wrong(saved_pair):
    outcome = outcome_of(replace(ALL, form="amass"), str(saved_pair))
    assert "SMPL-X" in outcome.refused
    assert not is_wrong(ALL, outcome)


def test_a_difference_above_the_limit_of_the_row_is_wrong():
    assert not is_wrong(ALL, Opened(difference=ALL.limit))
    assert is_wrong(ALL, Opened(difference=2 * ALL.limit))


@pytest.mark.slow
@pytest.mark.parametrize(
    "reader", READERS, ids=lambda reader: f"{reader.form}-{reader.distribution}"
)
def test_what_the_table_says_arrives(reader, saved_pair):
    if reader.missing:
        pytest.skip(reader.missing)
    (outcome,) = outcomes_of(reader, [str(saved_pair)])
    assert not is_wrong(reader, outcome)
    wanted = "" if outcome.refused else ROWS[reader.form, reader.distribution][-1]
    assert re.sub(r"[\d,.]+", "", outcome.more) == re.sub(r"[\d,.]+", "", wanted)
