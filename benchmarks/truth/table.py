"""The table of figures to reach, from the records of everybody."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from physic_testing.metrics import ValueWithInterval, markdown_table

from .statistics import Record, Strata, figure, of_lists, of_sets, pooled, rms_of

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
    """A figure of the table; ``goal`` in words, ``form`` a format of numbers."""

    name: str
    figure: ValueWithInterval
    goal: str = ""
    form: str = ".0f"

    def text(self, number: float) -> str:
        """As printed."""
        return f"{number:{self.form}}".replace("%", " %") if math.isfinite(number) else "-"

    @property
    def interval(self) -> str:
        """As printed; empty where there is none."""
        known = math.isfinite(self.figure.low)
        return f"{self.text(self.figure.low)} .. {self.text(self.figure.high)}" if known else ""


_RMS = partial(pooled, average=rms_of)
_SHARE = ".0%"


def rows_of(
    people: Sequence[Record], floors: Sequence[Record], photos: Sequence[Record]
) -> list[Row]:
    """All rows, those of a data set that was not run with no number."""
    everybody = [r for r in people if r["set"] in CAMERA_SETS]
    found = [r for r in everybody if r["found"]]
    parkour = _of(people, "parkour", found=True)
    return [
        *_people_rows(people),
        *_pose_rows(found),
        *_scene_rows(floors, _of(photos, "rgbd")),
        *_sigma_rows(found, floors),
        _row("PA-MPJPE mm, parkour", "pa_mpjpe_mm", parkour, pooled, "<= 80"),
        *_spread_rows(everybody),
        *_usable_rows(people),
        *up_rows(floors),
    ]


def _of(records: Sequence[Record], *sets: str, **fixed: Any) -> list[Record]:
    """The records of some sets, or of all, with these values."""
    return [
        r
        for r in records
        if (not sets or r["set"] in sets) and all(r.get(k) == v for k, v in fixed.items())
    ]


def _row(
    name: str,
    key: str,
    records: Sequence[Record],
    statistic: Callable[[str], Callable[[Strata], float]],
    goal: str = "",
    form: str = ".0f",
) -> Row:
    """A row about the records that have a list, or a finite number."""
    known = [
        r for r in records if isinstance(r.get(key), list) or math.isfinite(r.get(key, math.nan))
    ]
    return Row(name, figure(known, statistic(key)), goal, form)


def _people_rows(people: Sequence[Record]) -> list[Row]:
    goals = {**dict.fromkeys((*CAMERA_SETS, "parkour"), "all"), "people2d": ">= 34 of 38"}
    joints = _of(people, "people2d", found=True)
    words = "2D joints off, share of the box's diagonal: visible"
    return [
        *(
            _row(f"people found, {name}", "found", _of(people, name), pooled, goal, _SHARE)
            for name, goal in goals.items()
        ),
        _row(words, "visible", joints, of_lists, "<= .025", ".3f"),
        _row("  hidden", "hidden", joints, of_lists, "<= .07", ".3f"),
    ]


def _pose_rows(found: Sequence[Record]) -> list[Row]:
    upright, bent = (_of(found, posture=posture) for posture in ("upright", "bent"))
    depth = "depth of the pelvis, estimated / true, mean of sets"
    rows = []
    for name, key, records, mean, goal, form in (
        ("PA-MPJPE mm, upright", "pa_mpjpe_mm", upright, pooled, "<= 58", ".0f"),
        ("PA-MPJPE mm, on floor, seat or bent", "pa_mpjpe_mm", bent, pooled, "<= 85", ".0f"),
        ("root-aligned MPJPE mm, mean of sets", "root_aligned_mm", found, of_sets, "<= 95", ".0f"),
        ("MPJPE mm at own scale, mean of sets", "mpjpe_mm", found, of_sets, "<= 180", ".0f"),
        ("bones, estimated / true, mean of sets", "bones_ratio", found, of_sets, ".98-1.02", ".3f"),
        (depth, "pelvis_depth_ratio", found, of_sets, "", ".3f"),
    ):
        rows.append(_row(name, key, records, mean, goal, form))
        rows += [
            _row(f"  {a_set}", key, _of(records, a_set), pooled, "", form) for a_set in CAMERA_SETS
        ]
    return rows


def _scene_rows(floors: Sequence[Record], scenes: Sequence[Record]) -> list[Row]:
    missing = "  missing where one is in sight"
    return [
        _row("floor: angle deg", "floor_angle_deg", floors, pooled, "<= 2.5", ".1f"),
        _row(missing, "missing", floors, pooled, "<= 5 %", _SHARE),
        _row("  camera height off by", "camera_height_off", floors, pooled, "<= 8 %", _SHARE),
        _row("scene depth, absrel as it comes", "absrel", scenes, pooled, "<= .15", ".3f"),
        _row("  after one factor", "absrel_scaled", scenes, pooled, "<= .10", ".3f"),
    ]


def _sigma_rows(found: Sequence[Record], floors: Sequence[Record]) -> list[Row]:
    return [
        _row(f"{words}, rms", f"{key}_in_sigmas", records, _RMS, ".6-1.5", ".2f")
        for words, key, records in (
            ("distance over its stated sigma", "distance", found),
            ("stature over its stated sigma", "stature", found),
            ("error of a joint over its stated sigma", "joints", found),
            ("camera height over the stated sigma of the scale", "scale", floors),
        )
    ]


def _spread_rows(everybody: Sequence[Record]) -> list[Row]:
    rows = []
    for name, goal in (("panoptic", "<= .15"), ("roundtable", "")):
        once = {(r["set"], r["group"], r["person"]): r for r in _of(everybody, name)}
        words = f"spread of one pelvis over cameras, m, {name}"
        rows.append(_row(words, "spread_m", list(once.values()), pooled, goal, ".2f"))
    return rows


def _usable_rows(people: Sequence[Record]) -> list[Row]:
    """How often pose, place and size of people with 3D truth are all usable, and then wrong."""
    every = [
        {**r, "wrong": is_wrong_person(r), "usable": {"pose", "place", "size"} <= {*r["usable"]}}
        for r in _of(people, found=True)
        if math.isfinite(r.get("pa_mpjpe_mm", math.nan))
    ]
    words = "people with 3D truth whose pose, place and size are usable"
    usable = [r for r in every if r["usable"]]
    right = [r for r in every if not r["wrong"]]
    return [
        _row(words, "usable", every, pooled, "", _SHARE),
        _row("  measurably wrong of those", "wrong", usable, pooled, "none", _SHARE),
        _row("  usable of those that are not wrong", "usable", right, pooled, "", _SHARE),
    ]


def up_rows(floors: Sequence[Record]) -> list[Row]:
    """Errors of up, of the floor's normal and of the stated sigma of up, by data set."""
    return [
        _row(f"{words}, {name}", key, _of(floors, name), average, form=form)
        for name in CAMERA_SETS
        for key, words, average, form in (
            ("up_angle_deg", "up: angle deg, rms", _RMS, ".1f"),
            ("up_in_sigmas", "  over its sigma, rms", _RMS, ".2f"),
            ("floor_angle_deg", "  of the floor's normal, rms", _RMS, ".1f"),
        )
    ]


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
