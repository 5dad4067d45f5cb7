"""Every metric of a world's truth against itself, whole: no error, F1 of 1."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest

from physic_core.metrics.contact_scores import contact_scores
from physic_core.metrics.geodesic import geodesic_error, surface_graph
from physic_core.metrics.matching import match_by_masks
from physic_core.metrics.physics import contact_gap, penetration, vertex_areas
from physic_core.metrics.pose import BODY_JOINTS, mpjpe_mm, mpvpe_mm, pa_mpjpe_mm
from physic_core.metrics.scene import floor_error, scene_error
from physic_testing.worlds import CONTACT_DISTANCE, build_world


@pytest.mark.parametrize("name", ["stand", "sit_on_stool", "hug", "slope"])
def test_the_truth_is_perfect(name):
    world = build_world(name)
    people = np.arange(len(world.masks))
    matching = match_by_masks(world.masks, world.masks)
    np.testing.assert_array_equal(matching.predicted, people)
    np.testing.assert_array_equal(matching.truth, people)
    assert len(matching.missed) == len(matching.false_alarms) == 0

    assert mpjpe_mm(world.joints, world.joints).shape == (len(people),)
    assert mpjpe_mm(world.joints, world.joints).max() == mpvpe_mm(world.vertices, world.vertices).max() == 0
    assert pa_mpjpe_mm(world.joints, world.joints).max() < 1e-9

    assert astuple(contact_scores(world.contact, world.contact)) == (len(people), *[1.0] * 7)
    for across in (False, True):
        graph = surface_graph(world.vertices[0], world.faces, across=across)
        skin = geodesic_error(graph, world.contact, world.contact)
        assert skin.false_positive_cm.max() == skin.false_negative_cm.max() == skin.unreachable.max() == 0

    areas = vertex_areas(world.vertices, world.faces)
    assert ((areas.sum(1) > 0.5) & (areas.sum(1) < 3.5)).all()  # m^2 of skin
    inside = penetration(world.distance, areas, counted=world.outer)
    # Settled as well as the residual says, and inside only where they touch.
    assert (inside.max_depth <= world.residual + 1e-5).all()
    assert (inside.volume <= world.residual * (areas * world.contact).sum(1)).all()
    assert contact_gap(world.distance, world.contact).max() < CONTACT_DISTANCE

    for seen in (True, False):
        points = world.points(people=seen)
        valid = np.isfinite(points).all(-1)
        error = scene_error(points, points, valid, valid)
        assert error.pixels > 10_000
        assert astuple(error)[1:] == (1, 0, 0, 1, 0, 0, 0)
    assert astuple(floor_error(world.floor, world.floor)) == (pytest.approx(0, abs=1e-6), 0)


def test_a_known_fault_is_measured_and_nothing_else():
    world = build_world("hug")
    order = [1, 0]
    joints, vertices = world.joints[:, BODY_JOINTS], world.vertices
    moved = joints[order] + np.array([0, 0, 0.25], np.float32)
    matching = match_by_masks(world.masks[order], world.masks)
    np.testing.assert_array_equal(matching.predicted, order)
    pair = moved[matching.predicted], joints
    np.testing.assert_allclose(mpjpe_mm(*pair), 250, rtol=1e-5)
    np.testing.assert_allclose(mpvpe_mm(vertices + np.array([0, 0.03, 0.04], np.float32), vertices), 50, rtol=1e-4)
    np.testing.assert_allclose(pa_mpjpe_mm(*pair), 0, atol=1e-3)
