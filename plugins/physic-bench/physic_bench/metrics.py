"""The metrics by the names of the field, and the columns of the tables made of them.

Camera space, one photo, as in Human3R's evaluation: ``me_`` is metric, with nothing aligned; ``ca_`` is after the
middle of the hips was aligned; ``pa_`` is after the best similarity. The paper's MPJPE and MPVPE are ``me_mpjpe`` and
``me_pve``. Pelvis means the middle of both hips.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Record = Mapping[str, Any]


@dataclass(frozen=True)
class Column:
    """A figure of the tables: a function of sums over people.

    Attributes:
        key: unique.
        label: in the tables.
        definition: one sentence.
        sums: of one record, or None where the record has no value.
        value: of sums (..., k), an array (...).
        digits: printed.
        better: "low", "high" or "".
        factor: of the printed number.
    """

    key: str
    label: str
    definition: str
    sums: Callable[[Record], tuple[float, ...] | None]
    value: Callable[[Array], Array]
    digits: int = 1
    better: str = "low"
    factor: float = 1.0

    def text(self, number: float) -> str:
        """Return the number as printed; "-" if it is unknown."""
        return f"{self.factor * number:.{self.digits}f}" if np.isfinite(number) else "-"


def _one(record: Record, key: str) -> tuple[float, ...] | None:
    value = record.get(key)
    return None if value is None or not np.isfinite(value) else (float(value), 1.0)


def _ratio(top: Array, bottom: Array) -> Array:
    found: Array = np.where(bottom > 0, top / np.where(bottom > 0, bottom, 1.0), np.nan)
    return found


def _mean(sums: Array) -> Array:
    return _ratio(sums[..., 0], sums[..., 1])


def _harmonic(precision: Array, recall: Array) -> Array:
    return np.where(precision + recall > 0, _ratio(2 * precision * recall, precision + recall), 0.0 * precision)


def _mean_column(key: str, label: str, definition: str, **how: Any) -> Column:
    return Column(key, label, definition, partial(_one, key=key), _mean, **how)


COLUMNS: tuple[Column, ...] = (
    _mean_column("found", "people found", "share of the annotated people who have a body", better="high", digits=3),
    _mean_column("me_mpjpe", "MPJPE, mm", "mean distance of the joints, nothing aligned (me_mpjpe)"),
    _mean_column("ca_mpjpe", "CA-MPJPE, mm", "the same after the middle of the hips was aligned"),
    _mean_column("pa_mpjpe", "PA-MPJPE, mm", "the same after the best similarity"),
    _mean_column("rt_error", "root error, mm", "distance of the middle of the hips (rt_error)"),
    _mean_column("me_pve", "MPVPE, mm", "mean distance of the vertices, nothing aligned (me_pve)"),
    _mean_column("ca_pve", "CA-MPVPE, mm", "the same after the middle of the hips was aligned"),
    _mean_column("pa_pve", "PA-MPVPE, mm", "the same after the best similarity"),
    _mean_column("depth_ratio", "depth ratio", "depth of the hips over the true one", digits=3, better=""),
    _mean_column("focal_ratio", "focal ratio", "assumed focal length over the true one", digits=3, better=""),
    _mean_column("penetration_mm", "penetration, mm", "mean depth of the vertices inside the true scene; 0 without"),
    _mean_column("penetration_max_mm", "deepest, mm", "depth of the deepest vertex inside the true scene"),
    _mean_column("floating_mm", "floating, mm", "mean gap between the true scene and the vertices that truly touch it"),
    _mean_column(
        "geodesic_fp_cm", "geodesic FP, cm", "mean geodesic distance on the skin from predicted contact to true contact"
    ),
    _mean_column(
        "geodesic_fn_cm", "geodesic FN, cm", "mean geodesic distance on the skin from true contact to predicted contact"
    ),
    _mean_column("floor_angle_deg", "floor, deg", "angle between the floor's normal and up"),
    _mean_column(
        "camera_height_ratio", "camera height ratio", "height over the floor over the true one", digits=3, better=""
    ),
    _mean_column("spread_mm", "view spread, mm", "root mean squared distance of one pelvis, seen by several cameras"),
)
"""Columns without those of contact, which exist once for each contact truth."""

CONTACT_FIGURES = ("precision", "recall", "f1_of_means", "f1_mean", "f1_pooled")
"""As the paper: precision and recall are means over people, and F1 is that of the means. F1 as DECO: mean of F1."""

_CONTACT_WORDS = {
    "precision": ("precision", "mean precision of contact over people"),
    "recall": ("recall", "mean recall of contact over people"),
    "f1_of_means": ("F1", "harmonic mean of mean precision and mean recall, as the paper prints it"),
    "f1_mean": ("F1, mean", "mean over people of their F1, as DECO prints it"),
    "f1_pooled": ("F1, pooled", "F1 of the vertices of all people"),
}


def columns_for(rules: Sequence[str]) -> tuple[Column, ...]:
    """Return all columns, with those of each contact truth ("2 cm", "annotated")."""
    contact = tuple(_contact_column(rule, figure) for rule in rules for figure in CONTACT_FIGURES)
    return COLUMNS + contact


def _contact_column(rule: str, figure: str) -> Column:
    label, definition = _CONTACT_WORDS[figure]
    what = "annotated contact" if rule == "annotated" else f"contact by rule: within {rule} of the true scene"
    return Column(
        f"{figure}@{rule}",
        label if rule == "annotated" else f"{label} @ {rule}",
        f"{definition}; {what}",
        partial(_counts, rule=rule),
        partial(_contact_value, figure=figure),
        digits=3,
        better="high",
    )


def _counts(record: Record, rule: str) -> tuple[float, ...] | None:
    from physic_core.metrics import ContactCounts, precision_recall_f1

    counts = record.get("contact", {}).get(rule)
    if counts is None:
        return None
    hits, false_alarms, misses = (np.int64(counts[name]) for name in ("hits", "false_alarms", "misses"))
    own = precision_recall_f1(ContactCounts(np.asarray(hits), np.asarray(false_alarms), np.asarray(misses)))
    return (*(float(value) for value in own), float(hits), float(false_alarms), float(misses), 1.0)


def _contact_value(sums: Array, figure: str) -> Array:
    precision, recall, f1 = (_ratio(sums[..., k], sums[..., 6]) for k in range(3))
    if figure == "f1_pooled":
        hits = sums[..., 3]
        return _ratio(2 * hits, 2 * hits + sums[..., 4] + sums[..., 5])
    values = {"precision": precision, "recall": recall, "f1_mean": f1, "f1_of_means": _harmonic(precision, recall)}
    return values[figure]
