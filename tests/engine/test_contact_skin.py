"""Distances to skin: of other people, and of other parts of the own body."""

from __future__ import annotations

import pytest
import torch

from physic_core.engine.contact.distances import own_distances, people_distances
from physic_core.geometry.mesh import vertex_normals

FRONT = torch.tensor([0.0, 0.0, -1.0])
BACK = torch.tensor([0.0, 0.0, 1.0])


def sheet(depth, normal):
    """Points of a square of 20 cm, 1 cm apart, at a depth, and their normals."""
    steps = torch.arange(0, 0.2, 0.01)
    a, b = torch.meshgrid(steps, steps, indexing="xy")
    points = torch.stack([a, b, torch.full_like(a, depth)], -1).reshape(-1, 3)
    return points, normal.expand_as(points)


def two_people(depth, first, second):
    a, along_a = sheet(0.0, first)
    b, along_b = sheet(depth, second)
    outer = torch.ones(len(a), dtype=torch.bool)
    return people_distances(torch.stack([a, b]), torch.stack([along_a, along_b]), outer)


@pytest.mark.parametrize("depth", [0.03, -0.02])
def test_the_distance_is_signed_along_the_normal_of_the_other_person(depth):
    found = two_people(depth, BACK, FRONT)
    assert found.distance[0].tolist() == pytest.approx([depth] * 400, abs=1e-6)
    assert found.person[0].unique().tolist() == [1]
    assert torch.equal(found.vertex[0], torch.arange(400))


def test_skin_that_looks_the_same_way_does_not_touch():
    assert torch.isinf(two_people(0.03, FRONT, FRONT).distance).all()


def test_people_whose_vertices_are_not_finite_touch_no_other_person():
    points, normals = sheet(0.0, FRONT)
    bodies = torch.stack([points, torch.full_like(points, torch.nan)])
    outer = torch.ones(len(points), dtype=torch.bool)
    assert torch.isinf(people_distances(bodies, normals.expand_as(bodies), outer).distance).all()


def own(rest_gap, part):
    """Distances of two sheets of one body, 3 cm apart, and ``rest_gap`` in the rest pose."""
    a, along_a = sheet(0.0, BACK)
    b, along_b = sheet(0.03, FRONT)
    vertices = torch.cat([a, b])
    rest = torch.cat([a, b + torch.tensor([0.0, 0.0, rest_gap])])
    parts = torch.tensor([0] * 400 + [part] * 400)
    outer = torch.ones(800, dtype=torch.bool)
    outer[0] = False
    return own_distances(
        vertices[None], torch.cat([along_a, along_b])[None], outer, parts, rest
    ).distance[0]


def test_a_hand_on_the_thigh_touches_the_leg_and_a_rest_pose_touches_nothing(body, make_stage):
    bends = {"left_shoulder": (0.0, 0.0, -1.75)}  # the hand is inside the thigh
    rest = body(*body.zero_pose(1)).vertices
    posed = make_stage([(bends, (0.0, 0.0, 3.0))]).vertices
    at_rest, touching = (
        own_distances(
            one,
            vertex_normals(one, body.faces),
            body.outer,
            body.part_of_vertex,
            rest[0].to(one),
        )
        for one in (rest, posed)
    )
    assert (at_rest.distance > 0.02).all()
    index = body.part_names.index
    hand = body.part_of_vertex == index("left_hand")
    near = hand & (touching.distance[0] < 0.02)
    assert near.sum() > 100
    assert body.part_of_vertex[touching.vertex[0, near]].mode().values == index("left_upper_leg")
