"""Precision, recall and F1 of per-vertex contact, with the averages pooled, F1 of means and mean F1.

The averages differ by several points on the same prediction. PhySIC prints the harmonic mean of its precision and
recall, so ``f1_pooled`` or ``f1_of_means``; DECO and BSTRO print ``f1_mean``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.metrics.shapes import require_bool_dtype, require_same_shape

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray

    Counts = NDArray[np.int64]


@dataclass(frozen=True)
class ContactCounts:
    """Numbers of contact vertices of each row (a person or an image).

    Attributes:
        hits: (...,) int64, predicted and true.
        false_alarms: (...,) int64, predicted only.
        misses: (...,) int64, true only.
    """

    hits: Counts
    false_alarms: Counts
    misses: Counts


@dataclass(frozen=True)
class ContactScores:
    """Contact scores over all rows, each in [0, 1]; NaN without rows.

    Attributes:
        rows: number of people or images.
        precision_pooled: over the vertices of all rows.
        recall_pooled: over the vertices of all rows.
        f1_pooled: harmonic mean of ``precision_pooled`` and ``recall_pooled``.
        precision_mean: mean over rows.
        recall_mean: mean over rows.
        f1_of_means: harmonic mean of ``precision_mean`` and ``recall_mean``.
        f1_mean: mean of the rows' F1.
    """

    rows: int
    precision_pooled: float
    recall_pooled: float
    f1_pooled: float
    precision_mean: float
    recall_mean: float
    f1_of_means: float
    f1_mean: float


def contact_counts(predicted: BoolArray, truth: BoolArray) -> ContactCounts:
    """Count predicted and true contact vertices.

    Args:
        predicted: (..., V) bool.
        truth: (..., V) bool, on the same mesh.

    Raises:
        PhysicError: the shapes differ, or an array is not bool.
    """
    require_same_shape("contact maps", predicted, truth)
    predicted, truth = require_bool_dtype("predicted contact", predicted), require_bool_dtype("true contact", truth)
    return ContactCounts(
        hits=np.asarray((predicted & truth).sum(-1), np.int64),
        false_alarms=np.asarray((predicted & ~truth).sum(-1), np.int64),
        misses=np.asarray((truth & ~predicted).sum(-1), np.int64),
    )


def precision_recall_f1(counts: ContactCounts) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return precision, recall and F1 (...,) float64 of each row.

    As in DECO's code, a row without predicted contact has P = 1, R = 0, F1 = 0, and a row with predicted but no true
    contact has P = 0, R = 1, F1 = 0.
    """
    hits = counts.hits.astype(np.float64)
    predicted, true = counts.hits + counts.false_alarms, counts.hits + counts.misses
    precision = np.where(predicted > 0, hits / np.maximum(predicted, 1), 1.0)
    recall = np.where(true > 0, hits / np.maximum(true, 1), 1.0)
    recall = np.where(predicted > 0, recall, 0.0)
    return precision, recall, _harmonic(precision, recall)


def contact_scores(predicted: BoolArray, truth: BoolArray) -> ContactScores:
    """Score the contact of matched people, one row each; :func:`precision_recall_f1` defines scores of empty sets.

    Args:
        predicted: (..., V) bool.
        truth: (..., V) bool, on the same mesh.

    Raises:
        PhysicError: the shapes differ, or an array is not bool.
    """
    counts = contact_counts(predicted, truth)
    rows = int(counts.hits.size)
    if not rows:
        return ContactScores(0, *[float("nan")] * 7)
    total = ContactCounts(*(np.asarray(c.sum()) for c in (counts.hits, counts.false_alarms, counts.misses)))
    precision_pooled, recall_pooled, f1_pooled = (float(value) for value in precision_recall_f1(total))
    precision, recall, f1 = (value.mean() for value in precision_recall_f1(counts))
    return ContactScores(
        rows=rows,
        precision_pooled=precision_pooled,
        recall_pooled=recall_pooled,
        f1_pooled=f1_pooled,
        precision_mean=float(precision),
        recall_mean=float(recall),
        f1_of_means=float(_harmonic(precision, recall)),
        f1_mean=float(f1),
    )


def _harmonic(precision: FloatArray, recall: FloatArray) -> FloatArray:
    total = precision + recall
    mean: FloatArray = 2 * precision * recall / np.where(total > 0, total, 1.0)
    return mean
