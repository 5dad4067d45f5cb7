"""The table of figures to reach, from the records of everybody."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from physic_testing.metrics import ValueWithInterval, markdown_table

from .statistics import Record, Strata, figure, median_of, of_lists, of_sets, pooled, rms_of

CAMERA_SETS = ("mpi_inf_3dhp", "panoptic", "roundtable")
WRONG = {
    "pa_mpjpe_mm": 150.0,
    "pelvis_depth_ratio": 0.25,
    "floor_angle_deg": 10.0,
    "camera_height_off": 0.25,
}
"""Beyond one of these a result is measurably wrong, as it is where somebody is missed."""


@dataclass(frozen=True)
class Row:
    """A figure of the table; ``goal`` in words."""

    name: str
    figure: ValueWithInterval
    goal: str
    digits: int = 0
    percent: bool = False

    def text(self, number: float) -> str:
        """As printed."""
        if not math.isfinite(number):
            return "-"
        return f"{100 * number:.0f} %" if self.percent else f"{number:.{self.digits}f}"

    @property
    def interval(self) -> str:
        """As printed; empty where there is none."""
        known = math.isfinite(self.figure.low)
        return f"{self.text(self.figure.low)} .. {self.text(self.figure.high)}" if known else ""


def rows_of(
    people: Sequence[Record], floors: Sequence[Record], photos: Sequence[Record]
) -> list[Row]:
    """All rows, those of a data set that was not run with no number."""

    def of(records: Sequence[Record], *sets: str, **fixed: Any) -> list[Record]:
        return [
            r
            for r in records
            if (not sets or r["set"] in sets) and all(r.get(k) == v for k, v in fixed.items())
        ]

    def known(records: Sequence[Record], key: str) -> list[Record]:
        return [r for r in records if math.isfinite(r.get(key, math.nan))]

    def row(
        name: str,
        records: Sequence[Record],
        statistic: Callable[[Strata], float],
        goal: str = "",
        **how: Any,
    ) -> Row:
        return Row(name, figure(records, statistic), goal, **how)

    everybody = of(people, *CAMERA_SETS)
    found = of(people, *CAMERA_SETS, found=True)
    rows = [
        row(f"people found, {name}", of(people, name), pooled("found"), goal, percent=True)
        for name, goal in {
            **dict.fromkeys((*CAMERA_SETS, "parkour"), "all"),
            "people2d": ">= 34 of 38",
        }.items()
    ]
    annotated = of(people, "people2d", found=True)
    rows += [
        row(
            "2D joints off, share of the box's diagonal: visible",
            annotated,
            of_lists("visible"),
            "<= .025",
            digits=3,
        ),
        row("  median of visible", annotated, of_lists("visible", median_of), digits=3),
        row("  hidden", annotated, of_lists("hidden"), "<= .07", digits=3),
    ]
    for posture, words, goal in (
        ("upright", "upright", "<= 58"),
        ("bent", "on floor, seat or bent", "<= 85"),
    ):
        mine = [r for r in found if r["posture"] == posture]
        rows.append(row(f"PA-MPJPE mm, {words}", mine, pooled("pa_mpjpe_mm"), goal))
        rows += [row(f"  {name}", of(mine, name), pooled("pa_mpjpe_mm")) for name in CAMERA_SETS]
    for key, words, goal, digits in (
        ("root_aligned_mm", "root-aligned MPJPE mm, mean of sets", "<= 95", 0),
        ("mpjpe_mm", "MPJPE mm at own scale, mean of sets", "<= 180", 0),
        (
            "mpjpe_scaled_mm",
            "MPJPE mm once the bones are scaled to the true ones, mean of sets",
            "",
            0,
        ),
        ("bones_ratio", "bones, estimated / true, mean of sets", ".98-1.02", 3),
        ("pelvis_depth_ratio", "depth of the pelvis, estimated / true, mean of sets", "", 3),
    ):
        mine = known(found, key)
        rows.append(row(words, mine, of_sets(key), goal, digits=digits))
        rows += [
            row(f"  {name}", of(mine, name), pooled(key), digits=digits) for name in CAMERA_SETS
        ]
    rows += [
        row(
            "floor: angle deg",
            known(of(floors), "floor_angle_deg"),
            pooled("floor_angle_deg"),
            "<= 2.5",
            digits=1,
        ),
        row(
            "  missing where one is in sight", of(floors), pooled("missing"), "<= 5 %", percent=True
        ),
        row(
            "  camera height off by",
            known(of(floors), "camera_height_off"),
            pooled("camera_height_off"),
            "<= 8 %",
            percent=True,
        ),
        row(
            "scene depth, absrel as it comes",
            known(of(photos, "rgbd"), "absrel"),
            pooled("absrel"),
            "<= .15",
            digits=3,
        ),
        row(
            "  after one factor",
            known(of(photos, "rgbd"), "absrel_scaled"),
            pooled("absrel_scaled"),
            "<= .10",
            digits=3,
        ),
    ]
    sure = known(found, "distance_in_sigmas")
    rows += [
        row(
            "distance over its stated sigma, rms",
            sure,
            pooled("distance_in_sigmas", rms_of),
            ".6-1.5",
            digits=2,
        ),
        row(
            "  stated sigma of the log distance, median",
            sure,
            pooled("distance_sigma", median_of),
            digits=3,
        ),
        row(
            "stature over its stated sigma, rms",
            known(found, "stature_in_sigmas"),
            pooled("stature_in_sigmas", rms_of),
            ".6-1.5",
            digits=2,
        ),
        row(
            "error of a joint over its stated sigma, rms",
            known(found, "joints_in_sigmas"),
            pooled("joints_in_sigmas", rms_of),
            ".6-1.5",
            digits=2,
        ),
        row(
            "camera height over the stated sigma of the scale, rms",
            known(of(floors), "scale_in_sigmas"),
            pooled("scale_in_sigmas", rms_of),
            ".6-1.5",
            digits=2,
        ),
    ]
    rows.append(
        row(
            "PA-MPJPE mm, parkour",
            of(people, "parkour", found=True),
            pooled("pa_mpjpe_mm"),
            "<= 80",
        )
    )
    for name, goal in (("panoptic", "<= .15"), ("roundtable", "")):
        once = {(r["set"], r["group"], r["person"]): r for r in of(everybody, name)}
        words = f"spread of one pelvis over cameras, m, {name}"
        rows.append(
            row(words, known(list(once.values()), "spread_m"), pooled("spread_m"), goal, digits=2)
        )
    measured = [photo for photo in of(photos) if photo["set"] != "rgbd"]
    judged = [{**photo, "wrong": is_wrong(photo, people, floors)} for photo in measured]
    bodies = [
        {**r, "wrong": is_wrong_person(r)} for r in known(of(people, found=True), "pa_mpjpe_mm")
    ]
    for words, graded in (
        ("photos", [r for r in judged if not r["error"]]),
        ("people with 3D truth", bodies),
    ):
        good = [{**r, "good": r["grade"] == "good"} for r in graded]
        rows += [
            row(f"{words} graded good", good, pooled("good"), percent=True),
            row(
                "  measurably wrong of those",
                [r for r in good if r["good"]],
                pooled("wrong"),
                "none",
                percent=True,
            ),
            row(
                "  graded good of those that are not wrong",
                [r for r in good if not r["wrong"]],
                pooled("good"),
                percent=True,
            ),
        ]
    rows += up_rows(of(floors))
    rows += [
        row(
            "deepest vertex of a body inside scene or floor, cm",
            of(photos, error=""),
            of_lists("inside_scene_cm"),
            digits=1,
        ),
        row(
            "  inside another body, cm, photos of several people",
            [r for r in of(photos, error="") if r["bodies"] > 1],
            of_lists("inside_people_cm"),
            digits=1,
        ),
        row("CPU seconds a photo", of(photos, error=""), pooled("cpu_s"), "<= 20 (720p)", digits=1),
        row("seconds a photo", of(photos, error=""), pooled("wall_s"), digits=1),
    ]
    return rows


def up_rows(floors: Sequence[Record]) -> list[Row]:
    """Errors of up, of the floor's normal and of the stated sigma of up, by data set."""
    rows = []
    for name in CAMERA_SETS:
        mine = [r for r in floors if r["set"] == name]
        for key, words, average, digits in (
            ("up_angle_deg", "up: angle deg, rms", rms_of, 1),
            ("up_angle_deg", "  median", median_of, 1),
            ("up_in_sigmas", "  over its sigma, rms", rms_of, 2),
            ("floor_angle_deg", "  of the floor's normal, rms", rms_of, 1),
            ("floor_angle_deg", "  median of that", median_of, 1),
        ):
            known = [r for r in mine if math.isfinite(r[key])]
            of = figure(known, pooled(key, average))
            rows.append(Row(f"{words}, {name}", of, "", digits))
    return rows


def is_wrong(photo: Record, people: Sequence[Record], floors: Sequence[Record]) -> bool:
    """Whether truth contradicts a result: somebody missed, or one of ``WRONG`` exceeded."""
    name = photo["set"], photo["photo"]
    mine = [r for r in people if (r["set"], r["photo"]) == name]
    ground = [r for r in floors if (r["set"], r["photo"]) == name]
    return (
        not all(r["found"] for r in mine)
        or any(is_wrong_person(r) for r in mine)
        or any(
            r[key] > WRONG[key] for r in ground for key in ("floor_angle_deg", "camera_height_off")
        )
    )


def is_wrong_person(person: Record) -> bool:
    """Whether truth contradicts a body that was found."""
    return bool(
        person.get("pa_mpjpe_mm", 0) > WRONG["pa_mpjpe_mm"]
        or abs(person.get("pelvis_depth_ratio", 1) - 1) > WRONG["pelvis_depth_ratio"]
    )


def text_table(rows: Sequence[Row]) -> str:
    """For a terminal and for Markdown alike."""
    cells = [["figure", "value", "95 % interval", "of", "to reach"]]
    for r in rows:
        name = f"&nbsp; {r.name.strip()}" if r.name.startswith(" ") else r.name
        cells.append([name, r.text(r.figure.value), r.interval, str(r.figure.count), r.goal])
    return markdown_table(cells)


def as_json(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Name, figure and goal of each row."""
    return [{"name": r.name.strip(), "goal": r.goal, **asdict(r.figure)} for r in rows]
