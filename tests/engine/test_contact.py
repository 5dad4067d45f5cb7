"""The contact map of a sphere over a plane, past a rim, and inside."""

from __future__ import annotations

import math

import pytest
import torch
import trimesh

from physic_core.engine.contact import contact_map, surface_distance
from physic_core.engine.presets import PRESETS
from physic_core.engine.settings import ContactSettings
from physic_core.geometry.neighbors import NearestScene

SETTINGS = PRESETS["default"].contact
RADIUS = 0.1
NOTHING = NearestScene(torch.zeros(0, 3), torch.zeros(0, 3))


def plane(spacing=0.01, half=0.5):
    """Points of y = 1 at z = 2 +- half, normals up."""
    steps = torch.arange(-half, half + 1e-6, spacing)
    x, z = torch.meshgrid(steps, steps, indexing="xy")
    points = torch.stack([x, torch.ones_like(x), z + 2], -1).reshape(-1, 3)
    return NearestScene(points, torch.tensor([0.0, -1.0, 0.0]).expand_as(points))


def sphere(gap):
    """Over y = 1 by ``gap``."""
    mesh = trimesh.creation.icosphere(4, RADIUS)
    return torch.tensor(mesh.vertices, dtype=torch.float32) + torch.tensor([0.003, 1 - RADIUS - gap, 2.004])


@pytest.mark.parametrize("surface", ["scene", "floor"])
@pytest.mark.parametrize("gap", [0.0, 0.015, -0.03])
def test_the_distance_of_a_sphere_is_its_height(surface, gap):
    vertices = sphere(gap)
    scene = plane() if surface == "scene" else NOTHING
    floor = None if surface == "scene" else (torch.tensor([0.0, -1.0, 0.0]), 1.0)
    outer = torch.ones(len(vertices), dtype=torch.bool)
    contact, distance = contact_map(vertices, scene, floor, outer, SETTINGS)
    height = 1 - vertices[:, 1]
    near = height < 0.14
    torch.testing.assert_close(distance[near], height[near], atol=1e-5, rtol=0)
    assert torch.isinf(distance[height > 0.16]).all()
    assert torch.equal(contact[near], (height <= 0.02)[near])
    assert not contact[~near].any()
    # A cap of 2 cm - gap holds (0.02 - gap) / (2 r) of a sphere's surface.
    assert contact.float().mean().item() == pytest.approx((0.02 - gap) / (2 * RADIUS), abs=0.02)


def test_gaps_between_points_are_no_distance():
    vertex = torch.tensor([[0.0, 0.99, 2.0]])  # 1 cm over the plane, 2.8 cm beside its nearest point
    scene = plane(spacing=0.04)
    by_plane, _ = surface_distance(vertex, scene, SETTINGS)
    by_point, _ = surface_distance(vertex, scene, ContactSettings(metric="point"))
    assert by_plane.item() == pytest.approx(math.hypot(0.01, math.hypot(0.02, 0.02) - 0.02), abs=1e-4)
    assert by_point.item() == pytest.approx(math.hypot(0.01, math.hypot(0.02, 0.02)), abs=1e-4)


def test_past_the_rim_of_a_surface_nothing_touches():
    vertex = torch.tensor([[0.6, 0.999, 2.0]])  # level with the plane, 10 cm beside it
    contact, distance = contact_map(vertex, plane(), None, torch.ones(1, dtype=torch.bool), SETTINGS)
    assert distance.item() == pytest.approx(0.08, abs=2e-3)
    assert not contact.item()


def test_far_inside_is_not_contact():
    vertex = torch.tensor([[0.0, 1.12, 2.0]])
    outer = torch.ones(1, dtype=torch.bool)
    assert contact_map(vertex, plane(), None, outer, PRESETS["release"].contact)[0].item()
    assert not contact_map(vertex, plane(), None, outer, SETTINGS)[0].item()


@pytest.mark.parametrize("height", [-0.05, -0.03, 0.03, 0.05])
def test_as_printed_contact_is_a_distance_on_either_side(height):
    vertex = torch.tensor([[0.0, 1.0 - height, 2.0]])
    contact, _ = contact_map(vertex, plane(), None, torch.ones(1, dtype=torch.bool), PRESETS["paper"].contact)
    assert contact.item() == (abs(height) < 0.04)


@pytest.mark.parametrize("surface", ["scene", "floor"])
def test_only_the_lower_side_of_a_sheet_touches_the_ground(surface):
    sheet = torch.tensor([[0.0, 0.995, 2.0], [0.0, 0.985, 2.0]])  # a sole 5 mm over the plane, its upper side 15 mm
    normals = torch.tensor([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    scene = plane() if surface == "scene" else NOTHING
    floor = None if surface == "scene" else (torch.tensor([0.0, -1.0, 0.0]), 1.0)
    both = torch.ones(2, dtype=torch.bool)
    facing = ContactSettings(facing=True)
    assert contact_map(sheet, scene, floor, both, facing, normals)[0].tolist() == [True, False]
    assert contact_map(sheet, scene, floor, both, SETTINGS, normals)[0].tolist() == [True, True]


def test_cavities_never_touch():
    vertices = sphere(0.0)
    outer = torch.zeros(len(vertices), dtype=torch.bool)
    contact, distance = contact_map(vertices, plane(), None, outer, SETTINGS)
    assert not contact.any()
    assert torch.isfinite(distance).any()


def test_the_nearer_of_scene_and_floor_counts():
    vertex = torch.tensor([[0.0, 0.97, 2.0]])
    outer = torch.ones(1, dtype=torch.bool)
    floor = (torch.tensor([0.0, -1.0, 0.0]), 0.98)  # 2 cm over the scene's plane
    assert contact_map(vertex, plane(), floor, outer, SETTINGS)[1].item() == pytest.approx(0.01, abs=1e-5)


def test_a_point_without_a_normal_has_no_inside():
    scene = NearestScene(torch.tensor([[0.0, 0.0, 2.0]]), torch.zeros(1, 3))
    distance, _ = surface_distance(torch.tensor([[0.0, 0.0, 2.05], [0.0, 0.0, 1.95]]), scene, SETTINGS)
    assert distance.tolist() == pytest.approx([0.05, 0.05])


def test_people_are_a_batch():
    vertices = torch.stack([sphere(0.0), sphere(0.05)])
    outer = torch.ones(vertices.shape[1], dtype=torch.bool)
    contact, distance = contact_map(vertices, plane(), None, outer, SETTINGS)
    for i in range(2):
        alone = contact_map(vertices[i], plane(), None, outer, SETTINGS)
        assert torch.equal(contact[i], alone[0])
        assert torch.equal(distance[i], alone[1])
