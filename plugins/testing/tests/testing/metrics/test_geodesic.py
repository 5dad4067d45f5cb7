"""Geodesic contact error: answers by hand, and by another method."""

from __future__ import annotations

import numpy as np
import pytest

from physic_testing.metrics import geodesic_error, surface_graph

pytestmark = pytest.mark.quick


def strip(cells):
    """A flat band of squares, 1 m wide, each of two triangles; vertex 2k + s lies at x = k, y =
    s.
    """
    vertices = np.array([[k, s, 0] for k in range(cells + 1) for s in (0, 1)], float)
    faces = [
        t
        for k in range(cells)
        for t in ([2 * k, 2 * k + 2, 2 * k + 1], [2 * k + 1, 2 * k + 2, 2 * k + 3])
    ]
    return vertices, np.array(faces)


def marks(count, *ids):
    flags = np.zeros(count, bool)
    flags[list(ids)] = True
    return flags


def test_errors_on_a_strip_equal_those_computed_by_hand():
    graph = surface_graph(*strip(5))
    # x = 0, 2, 5 against 2, 3 on one side
    predicted = marks(12, 0, 4, 10)
    truth = marks(12, 4, 6)
    error = geodesic_error(graph, predicted, truth)
    assert error.false_positive_cm == pytest.approx(100 * (2 + 0 + 2) / 3)
    assert error.false_negative_cm == pytest.approx(100 * (0 + 1) / 2)
    assert error.unreachable == 0


def test_an_empty_set_has_no_error():
    graph = surface_graph(*strip(2))
    for guess, fact in ((marks(6), marks(6, 0)), (marks(6, 0), marks(6))):
        error = geodesic_error(graph, guess, fact)
        assert np.isnan([error.false_positive_cm, error.false_negative_cm]).all()


def test_unreachable_vertices_are_counted_separately():
    vertices, faces = strip(1)
    graph = surface_graph(
        np.concatenate([vertices, vertices + 9]), np.concatenate([faces, faces + 4])
    )
    error = geodesic_error(graph, marks(8, 1, 6), marks(8, 0))
    assert (error.false_positive_cm, error.false_negative_cm, error.unreachable) == (
        pytest.approx(100),
        100,
        1,
    )
    error = geodesic_error(graph, marks(8, 6), marks(8, 0))
    assert np.isnan([error.false_positive_cm, error.false_negative_cm]).all()
    assert error.unreachable == 2
