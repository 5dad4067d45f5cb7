"""Statistics of the records of :mod:`benchmarks.truth.estimator_errors`, with intervals, as one table."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from physic_core.metrics import ValueWithInterval, markdown_table

from .statistics import figure

Record = Mapping[str, Any]
Records = Sequence[Record]


@dataclass(frozen=True)
class Statistic:
    """One number over the records of a kind.

    Attributes:
        kind: key of the records.
        value: picks the values of a record that count.
        reduce: reduces them to the number.
    """

    kind: str
    value: Callable[[Record], Sequence[Any]]
    reduce: Callable[[Sequence[float]], float]


def _of(key: str, where: Callable[[Record], bool] = lambda r: True) -> Callable[[Record], Sequence[Any]]:
    return lambda r: [r[key]] if where(r) and r.get(key) is not None else []


def _list(key: str) -> Callable[[Record], Sequence[Any]]:
    return lambda r: r.get(key, ())


def _quantile(share: float) -> Callable[[Sequence[float]], float]:
    return lambda values: float(np.quantile(np.abs(values), share))


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))


def _sd(values: Sequence[float]) -> float:
    return float(np.std(values))


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _shown(r: Record) -> bool:
    return bool(r["seen"] != 0)


def _hidden(r: Record) -> bool:
    return bool(r["seen"] == 0)


def _kept(r: Record) -> bool:
    return not r["flipped"]


def _touching(kind: str, touches: bool) -> Callable[[Record], Sequence[Any]]:
    return lambda r: [r["share"] > 0] if r["kind"] == kind and r["touches"] == touches else []


_median = _quantile(0.5)

STATISTICS: dict[str, Statistic] = {
    "people who are found": Statistic("people", _of("found", lambda r: r["joints"] > 0), _mean),
    "keypoints, not marked hidden: median error, share of the box": Statistic(
        "keypoints", _of("error", _shown), _median
    ),
    "keypoints, not marked hidden: 90th percentile": Statistic("keypoints", _of("error", _shown), _quantile(0.9)),
    "keypoints, hidden: median error": Statistic("keypoints", _of("error", _hidden), _median),
    "keypoints, hidden: 90th percentile": Statistic("keypoints", _of("error", _hidden), _quantile(0.9)),
    "keypoints, not marked hidden: confidence below .3": Statistic(
        "keypoints", lambda r: [r["confidence"] < 0.3] if _shown(r) else [], _mean
    ),
    "keypoints, hidden: confidence above .5": Statistic(
        "keypoints", lambda r: [r["confidence"] > 0.5] if _hidden(r) else [], _mean
    ),
    "arms or legs swapped": Statistic(
        "keypoints", lambda r: [v for k in ("arms", "legs") if (v := r.get(f"swap_{k}")) is not None], _mean
    ),
    "bodies: PA-MPJPE mm, mean": Statistic("bodies", _of("pa_mpjpe_mm"), _mean),
    "bodies: PA-MPJPE mm, 90th percentile": Statistic("bodies", _of("pa_mpjpe_mm"), _quantile(0.9)),
    "trunk: lean towards the camera, rms deg": Statistic("bodies", _of("turn_right"), _rms),
    "trunk: yaw, rms deg": Statistic("bodies", _of("turn_down"), _rms),
    "trunk: in the image plane, rms deg": Statistic("bodies", _of("turn_away"), _rms),
    **{
        f"rotations of {name}: without that about the bone, rms deg": Statistic("bodies", _list(name), _rms)
        for name in ("spine", "hip", "knee", "shoulder", "elbow")
    },
    "limb segments: angle deg, median": Statistic("segments", _of("angle_deg"), _median),
    "limb segments: angle deg, 90th percentile": Statistic("segments", _of("angle_deg"), _quantile(0.9)),
    "limb segments: in the image plane, rms deg": Statistic("segments", _of("plane_deg"), _rms),
    "limb segments: tilt, not flipped, rms deg": Statistic("segments", _of("tilt_deg", _kept), _rms),
    "forearms flipped in depth": Statistic("segments", _of("flipped", lambda r: r["segment"] == "forearm"), _mean),
    "other limb segments flipped in depth": Statistic(
        "segments", _of("flipped", lambda r: r["segment"] != "forearm"), _mean
    ),
    "bones, log of estimated / true: mean": Statistic("bodies", _of("bones_log"), _mean),
    "bones, log of estimated / true: sd": Statistic("bodies", _of("bones_log"), _sd),
    "pelvis depth, log of estimated / true: mean": Statistic("bodies", _of("depth_log"), _mean),
    "pelvis depth, log of estimated / true: sd": Statistic("bodies", _of("depth_log"), _sd),
    "pelvis across the line of sight, mm": Statistic("bodies", _of("lateral_mm"), _rms),
    "photos with a floor mask": Statistic("depth", _of("floor_mask"), _mean),
    "point maps with and without people: log depth apart, median": Statistic("depth", _of("disagreement"), _median),
    "point maps with and without people: 90th percentile": Statistic("depth", _of("disagreement"), _quantile(0.9)),
    "point map on the floor: sd of log depth, median": Statistic("depth", _of("map_noise"), _median),
    "people against their floor, log depth: mean": Statistic("depth", lambda r: r.get("person_offsets", []), _mean),
    "people against their floor, log depth: sd": Statistic("depth", lambda r: r.get("person_offsets", []), _sd),
    "metric depth on the floor, log: mean": Statistic("depth", _of("floor_scale_log"), _mean),
    "metric depth on the floor, log: sd": Statistic("depth", _of("floor_scale_log"), _sd),
    "metric depth: offset of inverse depth, median": Statistic("depth", _of("bend"), lambda v: float(np.median(v))),
    "metric depth: offset of inverse depth, 90th percentile": Statistic("depth", _of("bend"), _quantile(0.9)),
    "metric depth: angle of its floor deg, median": Statistic("depth", _of("floor_angle_deg"), _median),
    "metric depth: angle of its floor deg, 90th percentile": Statistic("depth", _of("floor_angle_deg"), _quantile(0.9)),
    "metric depth: height of the camera, log: mean": Statistic("depth", _of("camera_height_log"), _mean),
    "metric depth: height of the camera, log: sd": Statistic("depth", _of("camera_height_log"), _sd),
    "feet that touch and are in the contact prior": Statistic("contact", _touching("foot", True), _mean),
    "feet that touch nothing and are in it": Statistic("contact", _touching("foot", False), _mean),
    "hands that touch and are in it": Statistic("contact", _touching("hand", True), _mean),
    "hands that touch nothing and are in it": Statistic("contact", _touching("hand", False), _mean),
}
"""Label of each statistic -> how it is computed."""


def statistics_of(records: Mapping[str, Records]) -> dict[str, ValueWithInterval]:
    """Return every statistic of the records by kind; each has its "set", "group" and "photo"."""
    return {label: _figure(records.get(one.kind, ()), one) for label, one in STATISTICS.items()}


def text_of(figures: Mapping[str, ValueWithInterval]) -> str:
    """Format figures as a Markdown table."""
    rows = [["statistic", "value", "95 % interval", "of"]]
    for label, f in figures.items():
        value = "-" if math.isnan(f.value) else f"{f.value:.3g}"
        between = "" if math.isnan(f.low) else f"{f.low:.3g} .. {f.high:.3g}"
        rows.append([label, value, between, str(f.count)])
    return markdown_table(rows)


def _figure(records: Records, statistic: Statistic) -> ValueWithInterval:
    """Return a statistic with its interval, and the number of its values; NaN without one."""

    def values(of: Records) -> list[float]:
        return [float(v) for record in of for v in statistic.value(record) if math.isfinite(v)]

    measured = [record for record in records if values([record])]
    if not measured:
        return ValueWithInterval(math.nan)
    found = figure(measured, lambda strata: statistic.reduce(values([r for stratum in strata for r in stratum])))
    return replace(found, count=len(values(measured)))
