"""Measure what each special rule of the engine is worth on photos with measured truth.

    python -m benchmarks.rules_on_photos DATA OUT --sets parkour [--groups FILM,...] [--photos N] [--only NAME,...]

The rules are those of ``benchmarks.rules``. Networks run once a photo, since their results are cached; the engine runs
once a row. Answers have the format of ``benchmarks.truth``. An interrupted run continues. The table is printed.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .rules import BASE, RULES, Rule
from .truth.__main__ import compared, samples_of
from .truth.measures import probability_scores
from .truth.run import measured_fields
from .truth.sets import Sample, picture_of


def main() -> int:
    """Run the missing rows and print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.rules_on_photos", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--sets", default="parkour")
    parser.add_argument("--groups", default="", help="films or moments, with commas between them; all if empty")
    parser.add_argument("--photos", type=int, default=None, help="the first N of each data set")
    parser.add_argument("--only", default="", help="names of rules, with commas between them")
    parser.add_argument("--without", default="", help="names of rules that every row goes without")
    given = parser.parse_args()
    groups = [name for name in given.groups.split(",") if name]
    samples = [
        s for s in samples_of([given.data], given.sets.split(","), None, None) if not groups or s.group in groups
    ][: given.photos]
    names = [name for name in given.only.split(",") if name]
    removed = [rule for rule in RULES if rule.name in given.without.split(",")]
    rows = [BASE, *(rule for rule in RULES if not names or rule.name in names)]
    for number, sample in enumerate(samples, 1):
        for rule in rows:
            answer_of(sample, rule, removed, given.out)
        print(f"[{number}/{len(samples)}] {sample.set} {sample.name}", file=sys.stderr, flush=True)
    print(table_of(samples, rows, given.out))
    return 0


def answer_of(sample: Sample, rule: Rule, removed: Sequence[Rule], out: Path) -> dict[str, Any]:
    """Return the answer of one row for one photo, from the file of an earlier run if there is one."""
    file = out / rule.name.replace(" ", "_") / f"{sample.set}-{sample.name}.json"
    if file.exists():
        known: dict[str, Any] = json.loads(file.read_text())
        return known
    import cv2

    from physic_core import Intrinsics, Pipeline, load_config
    from physic_core.errors import PhysicError
    from physic_core.types import CameraTrust

    picture = cv2.cvtColor(picture_of(sample), cv2.COLOR_BGR2RGB)
    height, width = picture.shape[:2]
    camera = None
    if sample.K is not None:
        fx, fy, cx, cy = (float(v) for v in sample.K[[0, 1, 0, 1], [0, 1, 2, 2]])
        camera = Intrinsics(fx, fy, cx, cy, width, height, trust=CameraTrust.KNOWN)
    overrides = [f"engine.{text}" for one in (rule, *removed) for text in one.settings]
    with Pipeline(load_config(preset="embedded", overrides=overrides)) as pipeline:
        try:
            result = pipeline(picture, intrinsics=camera)
            answer = {"error": "", **measured_fields(result, (width, height), sample)}
        except PhysicError as error:
            answer = {"error": str(error), "people": [], "floor": None, "checks": []}
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(answer))
    return answer


def table_of(samples: Sequence[Sample], rows: Sequence[Rule], out: Path) -> str:
    """Return the Markdown table: pose and contact of limbs of each row."""
    lines = [
        "| without | PA mm | feet, balanced | hands, balanced | seats, balanced | limbs' calibration error "
        "| photos changed |",
        "|---|" + "---|" * 6,
    ]
    base = [answer_of(s, BASE, (), out) for s in samples]
    for rule in rows:
        answers = [answer_of(s, rule, (), out) for s in samples]
        found = compared(samples, answers)
        poses = [p["pa_mpjpe_mm"] for p in found["people"] if p.get("pa_mpjpe_mm") is not None]
        cells = [f"{sum(poses) / len(poses):.1f}" if poses else "-"]
        limbs = ("feet", "hands", "seat")
        for name, kinds in (*(("balanced", (limb,)) for limb in limbs), ("calibration", limbs[:2])):
            mine = [one for one in found["parts"] if one["kind"] in kinds]
            scores = probability_scores([one["probability"] for one in mine], [one["touches"] for one in mine])
            cells.append(f"{scores[name]:.3f}" if mine else "-")
        changed = sum(a["people"] != b["people"] for a, b in zip(base, answers, strict=True))
        lines.append(f"| {rule.name} | {' | '.join(cells)} | {changed} of {len(samples)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
