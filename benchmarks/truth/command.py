"""How accurate a preset is on real photos with measured truth: a table with intervals, and every
number as JSON.

    python -m benchmarks truth DATA ... --out truth-results [--preset embedded | --config FILE]
    [--photos N] [--jobs 2]

DATA are folders that hold the data sets ``mpi_inf_3dhp``, ``panoptic``, ``roundtable``,
``people2d``, ``parkour`` and ``rgbd``, or some of them; missing ones are skipped.
    python -m benchmarks truth DATA ... --against CHECKOUT [--sample full]

compares this build with another on the same photos, and ends with 1 if a figure is worse.

Answers are kept in ``--out`` by the content of the code, so that an interrupted run continues.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import zip_longest
from pathlib import Path
from typing import Any

from benchmarks.fits import parser_of

from . import against
from .builds import ROOT, asked, build_of, measured_of, question_of
from .scores import compared
from .sets import SETS, Sample
from .table import rows_of, text_table


def main() -> int:
    """Run, compare, print."""
    parser = _parser()
    given = parser.parse_args()
    if given.against:
        options = given.preset, given.settings
        return against.main(given.data, given.against, given.out, given.sample, options)
    if unknown := sorted(set(given.sets.split(",")) - set(SETS)):
        parser.error(f"no data set is called {', '.join(unknown)}: choose of {', '.join(SETS)}")
    samples = samples_of(given.data, given.sets.split(","), given.photos)
    if not samples:
        print(
            "No data set found: nothing to measure. Name folders that hold some; see "
            "benchmarks/README.md."
        )
        return 0
    earlier = json.loads(given.triangulated.read_text()) if given.triangulated else {}
    records = compared(samples, _answers(samples, given), earlier)
    rows = rows_of(records)
    table = text_table(rows)
    counts = {name: sum(sample.set == name for sample in samples) for name in SETS}
    measured = {
        "preset": None if given.config else given.preset,
        "config": str(given.config) if given.config else None,
        "settings": given.settings,
        "counts": counts,
        "table": [
            {"name": r.figure.name, "value": r.this, "low": r.low, "high": r.high, "count": r.count}
            for r in rows
        ],
        **records,
    }
    _write(given.out, measured, records["triangulated"], table)
    print(table)
    print("photos: " + ", ".join(f"{name} {count}" for name, count in counts.items()))
    return 0


def _write(folder: Path, measured: Any, triangulated: Any, table: str) -> None:
    for name, content, indent in (("results", measured, 1), ("triangulated", triangulated, None)):
        text = json.dumps(without_nan(content), indent=indent, allow_nan=False)
        (folder / f"{name}.json").write_text(text)
    (folder / "table.md").write_text(table + "\n")


def _parser() -> argparse.ArgumentParser:
    parser = parser_of("truth", __doc__, fits=False)
    add = parser.add_argument
    add("data", nargs="*", type=Path, help="folders that hold the data sets")
    add("--out", type=Path, default=Path("truth-results"), help="for results and the table")
    add("--preset", default="embedded", help="preset of the tool")
    words = "configuration, in place of a preset"
    add("--config", type=Path, metavar="FILE", help=words)
    setting = {"dest": "settings", "action": "append", "metavar": "KEY=VALUE"}
    add("--set", default=[], help="one setting", **setting)
    add("--sets", default=",".join(SETS), help="data sets, with commas between them")
    add("--photos", type=int, help="the first N of each data set")
    add("--jobs", type=int, default=1, help="photos at once")
    words = "do not give the tool the camera, where it is known"
    add("--no-camera", action="store_true", help=words)
    words = "joints of an earlier run, as truth"
    add("--triangulated", type=Path, metavar="FILE", help=words)
    words = "compare with the build of another checkout, which has an environment in .venv"
    add("--against", type=Path, metavar="CHECKOUT", help=words)
    words = "of --against: 25 or 60 minutes on two cores"
    add("--sample", choices=against.SIZES, default="short", help=words)
    return parser


def _answers(samples: Sequence[Sample], given: argparse.Namespace) -> list[dict[str, Any]]:
    """Return what is measured of the tool's answers to the samples."""
    preset = None if given.config else given.preset
    build = build_of(ROOT, preset, given.settings, given.config)

    def run(first: int) -> list[dict[str, Any]]:
        with asked(build, given.out) as ask:
            return [
                measured_of(ask(question_of(sample, with_camera=not given.no_camera)), sample)
                for sample in samples[first :: given.jobs]
            ]

    with ThreadPoolExecutor(given.jobs) as pool:
        parts = zip_longest(*pool.map(run, range(given.jobs)))
    return [answer for row in parts for answer in row if answer is not None]


def samples_of(folders: Sequence[Path], sets: Sequence[str], photos: int | None) -> list[Sample]:
    """The first ``photos`` of each data set that is there; says which is not."""
    samples: list[Sample] = []
    for name in sets:
        places = [folder / name for folder in folders if (folder / name).is_dir()]
        if not places:
            print(
                f"{name}: not in "
                f"{' or '.join(map(str, folders)) or 'any folder, as none is named'}; skipped"
            )
            continue
        samples += SETS[name](places[0])[:photos]
    return samples


def without_nan(value: Any) -> Any:
    """JSON knows no NaN: what is unknown is null."""
    if isinstance(value, dict):
        return {key: without_nan(part) for key, part in value.items()}
    if isinstance(value, list):
        return [without_nan(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
