"""Precision, recall and F1 of per-vertex contact, with the averages pooled, F1 of means and mean
F1.

The averages differ by several points on the same prediction. PhySIC prints the harmonic mean of its
precision and recall, so ``f1_pooled`` or ``f1_of_means``; DECO and BSTRO print ``f1_mean``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from physic_core.errors import PhysicError
from physic_testing.metrics.shapes import require_bool_dtype, require_same_shape

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Int64Array, IntArray


@dataclass(frozen=True)
class ContactCounts:
    """Numbers of contact vertices of each row (a person or an image).

    Attributes:
        hits: (...,) int64, predicted and true.
        false_alarms: (...,) int64, predicted only.
        misses: (...,) int64, true only.
    """

    hits: Int64Array
    false_alarms: Int64Array
    misses: Int64Array


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
    predicted = require_bool_dtype("predicted contact", predicted)
    truth = require_bool_dtype("true contact", truth)
    return ContactCounts(
        hits=np.asarray((predicted & truth).sum(-1), np.int64),
        false_alarms=np.asarray((predicted & ~truth).sum(-1), np.int64),
        misses=np.asarray((truth & ~predicted).sum(-1), np.int64),
    )


def precision_recall_f1(counts: ContactCounts) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return precision, recall and F1 (...,) float64 of each row.

    As in DECO's code, a row without predicted contact has P = 1, R = 0, F1 = 0, and a row with
    predicted but no true contact has P = 0, R = 1, F1 = 0.
    """
    hits = counts.hits.astype(np.float64)
    predicted = counts.hits + counts.false_alarms
    true = counts.hits + counts.misses
    precision = np.where(predicted > 0, hits / np.maximum(predicted, 1), 1.0)
    recall = np.where(true > 0, hits / np.maximum(true, 1), 1.0)
    recall = np.where(predicted > 0, recall, 0.0)
    return precision, recall, _harmonic(precision, recall)


def contact_scores(predicted: BoolArray, truth: BoolArray) -> ContactScores:
    """Score the contact of matched people, one row each; :func:`precision_recall_f1` defines scores
    of empty sets.

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
    total = ContactCounts(
        *(np.asarray(c.sum()) for c in (counts.hits, counts.false_alarms, counts.misses))
    )
    precision_pooled, recall_pooled, f1_pooled = (
        float(value) for value in precision_recall_f1(total)
    )
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
    return 2 * precision * recall / np.where(total > 0, total, 1.0)


@dataclass(frozen=True)
class GeodesicError:
    """Geodesic contact errors of people, each (...,).

    Attributes:
        false_positive_cm: mean distance from predicted contact vertices to the nearest true one.
        false_negative_cm: mean distance from true contact vertices to the nearest predicted one.
        unreachable: int64, vertices excluded from both means, since no path leads to the other set.
    """

    false_positive_cm: FloatArray
    false_negative_cm: FloatArray
    unreachable: Int64Array


def surface_graph(vertices: FloatArray, faces: IntArray) -> csr_array:
    """Build the edge graph of a mesh; one graph of the rest pose serves all people.

    Args:
        vertices: (V, 3) m, any frame.
        faces: (F, 3) vertex ids.

    Returns:
        (V, V) float64 m, upper triangle; coinciding vertices keep an edge of length 0.
    """
    vertices = np.asarray(vertices, np.float64)
    sides = np.asarray(faces, np.int64)[:, [[0, 1], [1, 2], [2, 0]]]
    edges = np.unique(np.sort(sides.reshape(-1, 2), axis=1), axis=0)
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    return csr_array((lengths, (edges[:, 0], edges[:, 1])), shape=(len(vertices), len(vertices)))


def distance_to_sources(graph: csr_array, sources: BoolArray) -> FloatArray:
    """Return the distance (V,) m from every vertex to the nearest source; inf if there is no path.

    Args:
        graph: of :func:`surface_graph`.
        sources: (V,) bool.
    """
    if not sources.any():
        return np.full(graph.shape[0], np.inf)
    distance: FloatArray = dijkstra(
        graph, directed=False, indices=np.flatnonzero(sources), min_only=True
    )
    return distance


def geodesic_error(graph: csr_array, predicted: BoolArray, truth: BoolArray) -> GeodesicError:
    """Compute the geodesic contact error (DECO, ICCV 2023; BSTRO, CVPR 2022); NaN if either set is
    empty.

    Args:
        graph: of :func:`surface_graph`, on the mesh of the contact maps.
        predicted: (..., V) bool.
        truth: (..., V) bool.

    Raises:
        PhysicError: the shapes do not match, or a map is not bool.
    """
    require_same_shape("contact maps", predicted, truth)
    predicted = require_bool_dtype("predicted contact", predicted)
    truth = require_bool_dtype("true contact", truth)
    if predicted.shape[-1] != graph.shape[0]:
        raise PhysicError(
            f"The contact maps have {predicted.shape[-1]} vertices and the graph {graph.shape[0]}: "
            "build the graph from the mesh that the contact is on."
        )
    shape = predicted.shape[:-1]
    rows = list(
        zip(predicted.reshape(-1, graph.shape[0]), truth.reshape(-1, graph.shape[0]), strict=True)
    )
    positive = np.zeros(len(rows))
    negative = np.zeros(len(rows))
    unreachable = np.zeros(len(rows), np.int64)
    for i, (guess, fact) in enumerate(rows):
        if not (guess.any() and fact.any()):
            positive[i] = negative[i] = np.nan
            continue
        ways = distance_to_sources(graph, fact)[guess], distance_to_sources(graph, guess)[fact]
        positive[i], negative[i] = (_mean_finite(path_lengths) * 100 for path_lengths in ways)
        unreachable[i] = sum(int(np.isinf(path_lengths).sum()) for path_lengths in ways)
    return GeodesicError(
        positive.reshape(shape), negative.reshape(shape), unreachable.reshape(shape)
    )


def _mean_finite(distance: FloatArray) -> float:
    finite = distance[np.isfinite(distance)]
    return float(finite.mean()) if len(finite) else float("nan")
