"""``benchmarks/exports_opened``: files of a result agree with it, and what does not is reported."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.exports_opened import READERS, Reader, outcome_of, outcomes_of


def corner(files, person):
    return files.points(person.vertices[:1])


def corners(files):
    return [corner(files, person) for _, person in files.bodies]


ALL = Reader("keypoints", "", "csv", corners, corner, "a vertex, m", 0.1)
"""Finds everybody."""


def test_a_file_opens_with_all_people_and_agrees_with_the_result(saved_pair):
    outcome = outcome_of(ALL, str(saved_pair))
    assert (outcome.fault, outcome.refused, outcome.difference) == ("", "", 0)


@pytest.mark.parametrize(
    ("read", "said"),
    [
        (lambda files: corners(files)[:1], "1 of 2 people"),
        (lambda files: [one + 1 for one in corners(files)], "differs by 1.73"),
    ],
)
def test_a_missing_person_an_error_of_the_reader_and_a_difference_are_faults(
    read, said, saved_pair
):
    assert said in outcome_of(replace(ALL, read=read), str(saved_pair)).fault


def test_a_format_that_refuses_a_result_is_neither_opened_nor_wrong(saved_pair):
    outcome = outcome_of(replace(ALL, form="amass"), str(saved_pair))
    assert "SMPL-X" in outcome.refused
    assert not outcome.fault


@pytest.mark.slow
@pytest.mark.parametrize(
    "reader", READERS, ids=lambda reader: f"{reader.form}-{reader.distribution}"
)
def test_installed_programs_open_the_files(reader, saved_pair):
    pytest.importorskip(reader.module)
    (outcome,) = outcomes_of(reader, [str(saved_pair)])
    assert not outcome.fault
