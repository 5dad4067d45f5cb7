"""Write the public figures to docs/figures.json, and into the pages that state them.

    python -m benchmarks figures [--truth RESULTS] [--given ROWS]

The figures are how often marks are right (what ``trust_on_photos`` wrote), what a photo costs
(``run_cost``), the errors on photos with measured truth (the ``results.json`` of ``truth`` that
``--truth`` names), and those of given bodies (the ``rows.json`` of ``given_bodies`` that
``--given`` names); else those that are there. ``tools/pages.py`` writes the pages.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tools"))

from docs_numbers import commit_of_code
from pages import FIGURES, write_pages

from physic_core.judge import CHECKS
from physic_core.judge.trust import ALL
from physic_core.types import MARKS

from .fits import parser_of
from .trust_on_photos import TRUST, VERDICTS, Row, judged, right_share

READERS = "vision-language models"
"""Who judged the people of the table."""

WAYS = ("in", "out")
"""Bodies as they are given, and as the engine returns them."""

TRUTH_ROWS = {
    "PA-MPJPE, mm, upright": 0,
    "PA-MPJPE, mm, on floor, seat or bent": 0,
    "PA-MPJPE, mm, films": 0,
    "root-aligned MPJPE, mm": 0,
    "MPJPE, mm": 0,
    "pelvis, mm": 0,
    "floor: angle, degrees": 1,
    "camera height off, %": 0,
}
"""Rows of the benchmark's table that pages show, with the digits that their counts allow."""


def main() -> int:
    """Measure, and write file and pages."""
    parser = parser_of("figures", __doc__, fits=False)
    parser.add_argument("--truth", type=Path, metavar="RESULTS", help="results.json of truth")
    parser.add_argument("--given", type=Path, metavar="ROWS", help="rows.json of given_bodies")
    given = parser.parse_args()
    earlier = json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.exists() else {}
    rows = [row for row in json.loads(VERDICTS.read_text(encoding="utf-8")) if row["verdicts"]]
    figures = {
        **earlier,
        "commit": commit_of_code(),
        "trust": trust_figures(rows),
        "truth": truth_figures(given.truth) if given.truth else earlier["truth"],
        "given_bodies": given_figures(given.given) if given.given else earlier["given_bodies"],
    }
    FIGURES.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    write_pages()
    return 0


def trust_figures(rows: Sequence[Row]) -> dict[str, Any]:
    """Return how often each mark is right, of people in photos that took no part in the fit."""
    fit = json.loads(TRUST.read_text(encoding="utf-8"))
    return {
        "people": len(rows),
        "photos": len({row["photo"] for row in rows}),
        "readers": len({reader for row in rows for reader in row["verdicts"]}),
        "read by": READERS,
        "agreement": fit["agreement of readers"],
        "right": {mark: share(rows, mark) for mark in (*MARKS, ALL)},
        "scores": fit["people who took no part"],
        "children": share([row for row in rows if row["child"]], ALL),
        "where a check fails": {
            name: share([row for row in rows if is_failed(row, name)], ALL) for name in CHECKS
        },
    }


def share(rows: Sequence[Row], mark: str) -> dict[str, float | None]:
    """Return the share of people whose mark is right, with their number."""
    verdicts = judged(rows, mark)
    return {
        "people": len(verdicts),
        "share": round(right_share(rows, mark), 2) if verdicts else None,
    }


def is_failed(row: Row, name: str) -> bool:
    """Return whether a check of a person fails."""
    return CHECKS[name].compare(row["checks"].get(name)).failed


def truth_figures(file: Path) -> dict[str, Any]:
    """Return the rows of a run of ``truth`` that pages show."""
    run: Mapping[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return {
        "commit": commit_of_code(),
        "preset": run["preset"],
        "photos": run["counts"],
        "rows": [
            {**row, "digits": TRUTH_ROWS[row["name"]]}
            for row in run["table"]
            if row["name"] in TRUTH_ROWS
        ],
    }


def given_figures(file: Path) -> dict[str, Any]:
    """Return the people of each data set, how many are better than given, and mean errors before
    and after.
    """
    rows = json.loads(file.read_text(encoding="utf-8"))
    sets: dict[str, Any] = {}
    for name in sorted({row["set"] for row in rows}):
        own = [row for row in rows if row["set"] == name]
        sets[name] = {
            "people": len(own),
            "better": sum(row["mpjpe_out"] < row["mpjpe_in"] for row in own),
            **{
                key: [round(_mean_size(row[f"{key}_{way}"] for row in own), 1) for way in WAYS]
                for key in ("mpjpe", "root", "foot_cm")
            },
        }
    return {"commit": commit_of_code(), "sets": sets}


def _mean_size(values: Iterable[float]) -> float:
    """Return the mean magnitude of the known values."""
    return fmean(abs(value) for value in values if math.isfinite(value))
