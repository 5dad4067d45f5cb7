"""Precision, recall and F1 of per-vertex contact, under all three ways in which papers average.

The ways differ by several points on one and the same prediction, and papers rarely name theirs. The F1 that PhySIC
prints is the harmonic mean of the precision and recall that it prints, so it is ``f1_pooled`` or ``f1_of_means``; DECO
and BSTRO print ``f1_mean``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from physic_core.errors import PhysicError
from physic_core.metrics.shapes import require_flags, require_same_shape

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray

    Counts = NDArray[np.int64]

__all__ = ["ContactCounts", "ContactScores", "Empty", "contact_counts", "contact_scores", "pool", "rates", "score"]

Empty = Literal["deco", "agreement"]
"""What empty sets score. "deco", the published code's rule: no vertex predicted is P = 1, R = 0, F1 = 0, whatever is
true; some predicted but none true is P = 0, R = 1, F1 = 0. "agreement": the same, but P = R = F1 = 1 where nothing is
predicted and nothing is true."""


@dataclass(frozen=True)
class ContactCounts:
    """Vertices of each row (a person or an image).

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
    """Scores over rows, each in [0, 1]; NaN where there is no row.

    Attributes:
        rows: how many people or images.
        precision_pooled: of the vertices of all rows together.
        recall_pooled: of the vertices of all rows together.
        f1_pooled: harmonic mean of these two.
        precision_mean: mean over rows.
        recall_mean: mean over rows.
        f1_of_means: harmonic mean of these two.
        f1_mean: mean of the rows' own F1.
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
    """Count vertices.

    Args:
        predicted: (..., V) bool.
        truth: (..., V) bool, on the same mesh.

    Raises:
        PhysicError: the shapes differ, or one is not bool.
    """
    require_same_shape("contact maps", predicted, truth)
    predicted, truth = require_flags("predicted contact", predicted), require_flags("true contact", truth)
    return ContactCounts(
        hits=np.asarray((predicted & truth).sum(-1), np.int64),
        false_alarms=np.asarray((predicted & ~truth).sum(-1), np.int64),
        misses=np.asarray((truth & ~predicted).sum(-1), np.int64),
    )


def pool(counts: ContactCounts, image: NDArray[np.integer]) -> ContactCounts:
    """Counts of images from counts of people.

    Args:
        counts: of N people.
        image: (N,) int, any number that names each person's image.

    Raises:
        PhysicError: there is not one number a person.
    """
    if counts.hits.shape != image.shape or image.ndim != 1:
        raise PhysicError(f"Give one image number a person: got {image.shape} for {counts.hits.shape} counts.")
    _, row = np.unique(image, return_inverse=True)
    rows = int(row.max()) + 1 if len(row) else 0

    def summed(values: Counts) -> Counts:
        total = np.zeros(rows, np.int64)
        np.add.at(total, row, values)
        return total

    return ContactCounts(summed(counts.hits), summed(counts.false_alarms), summed(counts.misses))


def rates(counts: ContactCounts, empty: Empty = "deco") -> tuple[FloatArray, FloatArray, FloatArray]:
    """Precision, recall and F1 (...,) float64 of each row.

    Args:
        counts: of rows.
        empty: what empty sets score.
    """
    hits = counts.hits.astype(np.float64)
    predicted, true = counts.hits + counts.false_alarms, counts.hits + counts.misses
    precision = np.where(predicted > 0, hits / np.maximum(predicted, 1), 1.0)
    recall = np.where(true > 0, hits / np.maximum(true, 1), 1.0)
    recall = np.where(predicted > 0, recall, 0.0)
    if empty == "agreement":
        recall = np.where((predicted == 0) & (true == 0), 1.0, recall)
    return precision, recall, _harmonic(precision, recall)


def score(counts: ContactCounts, empty: Empty = "deco") -> ContactScores:
    """Scores over all rows of ``counts``.

    Args:
        counts: of rows of any shape.
        empty: what empty sets score, of a row and of the pool.
    """
    rows = int(counts.hits.size)
    if not rows:
        return ContactScores(0, *[float("nan")] * 7)
    total = ContactCounts(*(np.asarray(c.sum()) for c in (counts.hits, counts.false_alarms, counts.misses)))
    precision_pooled, recall_pooled, f1_pooled = (float(value) for value in rates(total, empty))
    precision, recall, f1 = (value.mean() for value in rates(counts, empty))
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


def contact_scores(predicted: BoolArray, truth: BoolArray, empty: Empty = "deco") -> ContactScores:
    """Scores of matched people, each a row: :func:`score` of :func:`contact_counts`.

    Args:
        predicted: (..., V) bool.
        truth: (..., V) bool, on the same mesh.
        empty: what empty sets score.

    Raises:
        PhysicError: the shapes differ, or one is not bool.
    """
    return score(contact_counts(predicted, truth), empty)


def _harmonic(precision: FloatArray, recall: FloatArray) -> FloatArray:
    total = precision + recall
    mean: FloatArray = 2 * precision * recall / np.where(total > 0, total, 1.0)
    return mean
