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
from benchmarks.exports_opened import READERS, is_wrong, outcome_of, outcomes_of, row_of

DEPTH, KEYPOINTS, AMASS = (
    next(reader for reader in READERS if reader.form == form)
    for form in ("depth", "keypoints", "amass")
)
with (Path(__file__).parents[2] / "benchmarks" / "exports_opened.csv").open(newline="") as file:
    ROWS = {(cells[0], cells[1].split(" ")[0]): cells for cells in csv.reader(file)}


@pytest.mark.parametrize("reader", [KEYPOINTS, DEPTH])
def test_a_file_opens_with_all_people_and_agrees_with_the_result(reader, saved_pair):
    outcome = outcome_of(reader, str(saved_pair))
    assert not outcome.fault
    assert not is_wrong(reader, outcome)
    assert "| 1 of 1 |" in row_of(reader, [outcome])


@pytest.mark.parametrize(
    ("read", "said"),
    [
        (lambda files: Opened(1, 0.0), "1 of 2 people"),
        (lambda files: [][0], "IndexError"),
    ],
)
def test_a_missing_person_or_an_error_of_the_reader_is_no_opened_file(read, said, saved_pair):
    reader = replace(KEYPOINTS, read=read)
    outcome = outcome_of(reader, str(saved_pair))
    assert said in outcome.fault
    assert is_wrong(reader, outcome)
    assert "| 0 of 1 |" in row_of(reader, [outcome])


def test_a_format_that_refuses_a_result_is_neither_opened_nor_wrong(saved_pair):
    outcome = outcome_of(AMASS, str(saved_pair))
    assert "SMPL-X" in outcome.refused
    assert not is_wrong(AMASS, outcome)
    assert "| 0 of 0 | 1 |" in row_of(AMASS, [outcome])


def test_a_difference_above_the_limit_of_the_row_is_wrong():
    assert not is_wrong(DEPTH, Opened(difference=DEPTH.limit))
    assert is_wrong(DEPTH, Opened(difference=2 * DEPTH.limit))


@pytest.mark.slow
@pytest.mark.parametrize(
    "reader", READERS, ids=lambda reader: f"{reader.form}-{reader.distribution}"
)
def test_what_the_table_says_arrives(reader, saved_pair):
    if reader.missing:
        pytest.skip(reader.missing)
    (outcome,) = outcomes_of(reader, [str(saved_pair)], None)
    assert not is_wrong(reader, outcome)
    wanted = "" if outcome.refused else ROWS[reader.form, reader.distribution or "Python"][-1]
    assert re.sub(r"[\d,.]+", "", outcome.more) == re.sub(r"[\d,.]+", "", wanted)
