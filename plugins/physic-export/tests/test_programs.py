"""Other programs open the exports: the table of docs/exports-opened.md, row by row."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
TABLE = {
    cells[0].rpartition(" ")[0]: cells
    for line in (ROOT / "docs" / "exports-opened.md").read_text(encoding="utf-8").splitlines()
    if len(cells := [cell.strip() for cell in line.strip("|").split("|")]) == 7
    and re.search(r"\d", cells[0])
}


@pytest.fixture(scope="module")
def tools(module_at):
    return module_at("tools/open_exports.py"), module_at("tools/read_exports.py")


@pytest.fixture(scope="module")
def files(tools, result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("exports")
    tools[0].write_exports(result, folder)
    if importlib.util.find_spec("rerun"):
        result.export(str(folder), "rrd")
    return folder


def test_the_table_has_a_row_with_its_version_for_each_program(tools):
    opening, reading = tools
    assert list(opening.VERSIONS) == list(reading.PROGRAMS)
    for program, version in opening.VERSIONS.items():
        assert TABLE[program][0] == f"{program} {version}"


@pytest.mark.slow
@pytest.mark.parametrize("program", TABLE)
def test_what_the_table_says_arrives_in(program, tools, files, result):
    opening, reading = tools
    distribution, module, _ = reading.PROGRAMS[program]
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"pip install {distribution}=={opening.VERSIONS[program]}")
    row = opening.opened(sys.executable, program, files)
    error = opening.place_error(result, row)
    _, _, place, colours, contact, joints, more = TABLE[program]
    assert (error is not None) == bool(place)
    assert error is None or error < opening.NEAR_M
    assert row["colours"] == colours
    assert (row["contact"] is not None) == (contact == "yes")
    assert row["contact"] is None or row["contact"] == pytest.approx(
        result.people[0].contact.mean(), abs=0.02
    )
    assert (f"{row['joints']} joints" if row["joints"] else "") == joints
    assert re.sub(r"[\d,.]+", "", row["more"]) == re.sub(r"[\d,.]+", "", more)
