"""Tables for spreadsheets."""

from __future__ import annotations

import csv
import io

import pytest

from physic_core.files import write_csv

pytestmark = pytest.mark.quick

FORMULAS = ("=1+1", "+1", "-1", "@SUM(1)", "\t=1", "\r=1", "\n=1", "＝1", "＋1", "－1", "＠1")


@pytest.mark.parametrize("text", [*FORMULAS, "'=1"])
def test_a_text_that_a_spreadsheet_would_compute_has_an_apostrophe_before_it(text):
    table = io.StringIO(newline="")
    write_csv(table, ["text", "number"], [{"text": text, "number": -1}, {"text": "a=b"}])
    _, *rows = csv.reader(table.getvalue().splitlines(keepends=True))
    assert rows == [[f"'{text}", "-1"], ["a=b", ""]]
