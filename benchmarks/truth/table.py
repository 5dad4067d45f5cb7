"""Figures of photos with measured truth, from the records of two builds, or of one alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from physic_testing.metrics import markdown_table

from .pairs import Figure, Pair, Row, compare, paired
from .sets import SETS

Record = Mapping[str, Any]
Records = Mapping[str, Sequence[Record]]

CAMERA_SETS = ("mpi_inf_3dhp", "panoptic", "roundtable")

WRONG_POSE_MM = 150.0
WRONG_DEPTH = 0.25
"""Aligned error of joints, and relative error of the distance, beyond which a person is measurably
wrong.
"""


def figures_of(other: Records, this: Records) -> Iterator[Figure]:
    """Yield the errors in what :func:`benchmarks.truth.scores.compared` returned for both
    builds.
    """
    people = [[_completed(r) for r in one["people"]] for one in (other, this)]
    yield from _joint_figures(people)
    yield from _floor_figures([one["floors"] for one in (other, this)])
    photos = [one["photos"] for one in (other, this)]
    for key, words in (("absrel", "as it comes"), ("absrel_scaled", "after one factor")):
        pairs = _percent(paired(key, *photos, unit=("photo",)))
        yield Figure(f"depth of the scene off, %, {words}", pairs)
    yield touch_figure("touch in films, Brier score", *(one["parts"] for one in (other, this)))


def _joint_figures(people: Sequence[Sequence[Record]]) -> Iterator[Figure]:
    for group, sets in (
        ("", CAMERA_SETS),
        (", one person a photo", CAMERA_SETS[:1]),
        (", rig", CAMERA_SETS[1:]),
    ):
        for key, words in (
            ("mpjpe_mm", "MPJPE, mm"),
            ("pelvis_mm", "pelvis, mm"),
            ("root_aligned_mm", "root-aligned MPJPE, mm"),
            ("pa_mpjpe_mm", "PA-MPJPE, mm"),
        ):
            yield Figure(words + group, paired(key, *_of_sets(people, *sets)))
    for posture, words in (("upright", "upright"), ("bent", "on floor, seat or bent")):
        mine = [[r for r in one if r.get("posture") == posture] for one in people]
        pairs = paired("pa_mpjpe_mm", *_of_sets(mine, *CAMERA_SETS))
        yield Figure(f"PA-MPJPE, mm, {words}", pairs)
    yield Figure("PA-MPJPE, mm, films", paired("pa_mpjpe_mm", *_of_sets(people, "parkour")))
    yield Figure("size of bodies off, %", paired("size_off", *people))
    yield Figure("people missed, %", paired("missed", *people), is_share=True)
    yield Figure("usable people who are wrong, %", paired("wrong", *people), is_share=True)
    for shown in ("visible", "hidden"):
        pairs = paired(shown, *people)
        yield Figure(f"2D joints off, % of the box: {shown}", pairs, form=".2f")


def _of_sets(people: Sequence[Sequence[Record]], *sets: str) -> list[list[Record]]:
    return [[r for r in one if r["set"] in sets] for one in people]


def _floor_figures(floors: Sequence[Sequence[Record]]) -> Iterator[Figure]:
    for key, words, is_share in (
        ("floor_angle_deg", "floor: angle, degrees", False),
        ("up_angle_deg", "up: angle, degrees", False),
        ("camera_height_off", "camera height off, %", False),
        ("missing", "floor missing, %", True),
    ):
        pairs = paired(key, *floors, unit=("photo",))
        yield Figure(words, _percent(pairs) if "%" in words else pairs, is_share=is_share)


def touch_figure(name: str, other: Sequence[Record], this: Sequence[Record]) -> Figure:
    """Return the Brier score of body parts that were judged."""
    both = [
        [{**r, "brier": (r["probability"] - r["touches"]) ** 2} for r in one]
        for one in (other, this)
    ]
    return Figure(name, paired("brier", *both, unit=("photo", "person", "part")), form=".3f")


def _completed(record: Record) -> dict[str, Any]:
    """Return a record with whether the person is missed or wrong, the error of size, and shares as
    percent.
    """
    completed = {**record, "missed": 100.0 * (not record["found"])}
    completed["size_off"] = 100 * abs(record.get("bones_ratio", math.nan) - 1)
    if {"pose", "place", "size"} <= {*record.get("usable", ())} and "pa_mpjpe_mm" in record:
        off = abs(record.get("pelvis_depth_ratio", 1) - 1)
        completed["wrong"] = 100.0 * (record["pa_mpjpe_mm"] > WRONG_POSE_MM or off > WRONG_DEPTH)
    for key in ("visible", "hidden"):
        if key in record:
            completed[key] = [100 * value for value in record[key]]
    return completed


def _percent(pairs: Sequence[Pair]) -> list[Pair]:
    return [pair._replace(other=100 * pair.other, this=100 * pair.this) for pair in pairs]


def rows_of(records: Records) -> list[Row]:
    """Return the figures of one build: ``this`` with the interval of its own value. It has people
    missed of each set, errors over stated ones, and the spread of one person over cameras, too.
    """
    people, floors = records["people"], records["floors"]
    missed = [[_completed(r) for r in people]] * 2
    figures = [
        *figures_of(records, records),
        *(
            Figure(f"people missed, %, {name}", paired("missed", *_of_sets(missed, name)))
            for name in SETS
        ),
        *(
            Figure(
                f"{words} over its stated sigma, rms", paired(key, of, of, unit), _rms, form=".2f"
            )
            for words, key, of, unit in (
                ("distance", "distance_in_sigmas", people, ("photo", "person")),
                ("stature", "stature_in_sigmas", people, ("photo", "person")),
                ("a joint", "joints_in_sigmas", people, ("photo", "person")),
                ("camera height", "scale_in_sigmas", floors, ("photo",)),
                ("up", "up_in_sigmas", floors, ("photo",)),
            )
        ),
        Figure(
            "spread of one pelvis over cameras, m",
            paired("spread_m", people, people, ("group", "person")),
            form=".2f",
        ),
    ]
    return [
        compare(replace(one, pairs=[pair._replace(other=0.0) for pair in one.pairs]))
        for one in figures
    ]


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else math.nan


def text_table(rows: Sequence[Row]) -> str:
    """Return the figures of one build that were measured, for a terminal and for Markdown alike."""
    cells = [["figure", "value", "95 % interval", "of"]]
    for row in rows:
        if row.count:
            value = f"{row.this:{row.figure.form}}"
            cells.append([row.figure.name, value, row.interval, str(row.count)])
    return markdown_table(cells)
