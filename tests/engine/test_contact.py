"""Signed distances to the scene and the floor."""

from __future__ import annotations

import pytest
import torch

from physic_core.engine.contact.distances import ContactSurfaces, surface_distances
from physic_core.engine.contact.method import ContactStageMethod
from physic_core.geometry.neighbors import NearestPointSearch

from .conftest import UP, plane_of

pytestmark = pytest.mark.quick


def plane():
    """Points of y = 1 at z = 2 +- 0.5, normals up."""
    steps = torch.linspace(-0.5, 0.5, 101)
    x, z = torch.meshgrid(steps, steps, indexing="xy")
    points = torch.stack([x, torch.ones_like(x), z + 2], -1).reshape(-1, 3)
    return NearestPointSearch(points, UP.expand_as(points))


def distances(vertices, scene, floor=None):
    row = torch.arange(len(scene.points))
    return surface_distances(
        vertices, ContactSurfaces(scene, row, floor), ContactStageMethod().measure
    )


def test_the_nearer_of_scene_and_floor_counts():
    vertex = torch.tensor([[0.0, 0.97, 2.0]])
    floor = plane_of(UP, 0.98)  # 2 cm over the scene's plane
    assert distances(vertex, plane(), floor).nearest.item() == pytest.approx(0.01, abs=1e-5)


def test_a_point_without_a_normal_has_no_inside():
    scene = NearestPointSearch(torch.tensor([[0.0, 0.0, 2.0]]), torch.zeros(1, 3))
    found = distances(torch.tensor([[0.0, 0.0, 2.05], [0.0, 0.0, 1.95]]), scene)
    assert found.scene.tolist() == pytest.approx([0.05, 0.05])
