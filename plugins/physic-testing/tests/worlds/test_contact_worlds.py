"""Worlds of contact: intended contacts touch, skin enters no skin, and partners, supports, dents,
items are true.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from physic_core.geometry.rays import RayCaster
from physic_testing.worlds import CONTACT_DISTANCE, World, build_world

from .float64_model import float64_model

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray

_SIZE = (96, 72)
_SAMPLE = ("hands_on_hips", "lean_on_post", "sit_on_cushion", "hold_ball", "hold_hands")


@pytest.fixture(scope="module", params=_SAMPLE)
def world(request: pytest.FixtureRequest) -> World:
    return build_world(request.param, 0, _SIZE)


def _part(name: str) -> BoolArray:
    part: BoolArray = float64_model().part_of_vertex.numpy() == float64_model().part_names.index(
        name
    )
    return part


def _surface(world: World, person: int, kept: BoolArray) -> trimesh.Trimesh:
    """The faces of a person all of whose corners are kept."""
    faces = world.faces[kept[world.faces].all(axis=1)]
    return trimesh.Trimesh(world.vertices[person].astype(float), faces, process=False)


def _apart(surface: trimesh.Trimesh, points: FloatArray) -> FloatArray:
    """Exact distances of points to the faces with the 60 nearest centres."""
    count = min(60, len(surface.faces))
    _, index = KDTree(surface.triangles_center).query(points, k=count)
    triangles = surface.triangles[index.reshape(-1)]
    closest = trimesh.triangles.closest_point(triangles, np.repeat(points, count, axis=0))
    distance: FloatArray = np.linalg.norm(
        closest.reshape(-1, count, 3) - points[:, None], axis=2
    ).min(axis=1)
    return distance


def _largest_penetration(points: FloatArray, mesh: trimesh.Trimesh) -> float:
    """Distance to the surface of the deepest point inside a closed mesh, m."""
    inside = points
    # its faces seen from behind
    for direction in ([0.31, 0.90, 0.30], [-0.80, 0.21, 0.56], [0.53, -0.42, -0.74]):
        hits = (
            RayCaster(mesh.vertices, mesh.faces)
            .first(inside, np.tile(direction, (len(inside), 1)))
            .face
        )
        inside = inside[(hits >= 0) & (mesh.face_normals[hits] @ direction > 0)]
    return float(_apart(mesh, inside).max()) if len(inside) else 0.0


def test_people_penetrate_neither_scene_nor_each_other(world: World) -> None:
    # The scene has its dents, but not the small objects.
    assert -world.distance[:, world.outer].min() < 0.01
    vertices = world.vertices.astype(float)
    for i, person in enumerate(vertices):
        for j, other in enumerate(vertices):
            if i != j:
                assert (
                    _largest_penetration(
                        person[world.outer], trimesh.Trimesh(other, world.faces, process=False)
                    )
                    < 0.01
                )
    if world.items:
        in_room = world.camera.to_room(vertices[:, world.outer])
        for block in world.room.blocks:
            if block.item:
                outside = np.abs(block.to_local(in_room)) - (np.array(block.half) - block.rounding)
                apart = np.linalg.norm(np.maximum(outside, 0), axis=-1) - block.rounding
                assert apart.min() > -0.01


def test_hands_on_hips_touch_the_trunk_and_nothing_else_does() -> None:
    world = build_world("hands_on_hips", 0, _SIZE)
    on_trunk = world.touched_own_part[0] == world.parts.index("torso")
    trunk = _surface(world, 0, _part("torso") & world.outer)
    for side in ("left", "right"):
        hand = np.flatnonzero(_part(f"{side}_hand") & world.outer)
        apart = _apart(trunk, world.vertices[0, hand].astype(float))
        assert apart.min() < 0.01  # the intended contact
        assert on_trunk[hand[apart < 0.012]].mean() > 0.8
        assert not on_trunk[hand[apart > 0.035]].any()
        assert (world.touched_own_part[0] == world.parts.index(f"{side}_hand")).any()
    assert (world.touched_own_part[0, _part("left_foot") | _part("right_foot")] == -1).all()
    assert not (world.touched_own_part == world.parts.index("head")).any()
    assert set(world.touched_person.ravel()) == set(world.touched_item.ravel()) == {-1}


def test_a_post_behind_the_back_carries() -> None:
    world = build_world("lean_on_post", 0, _SIZE)
    assert world.support[0, _part("torso")].any()
    assert world.support[0, _part("left_foot")].any()
    assert (world.support <= world.contact).all()
    standing = build_world("hands_on_hips", 0, _SIZE)
    assert not standing.support[0, ~(_part("left_foot") | _part("right_foot"))].any()


def test_a_cushion_gives_way_and_comes_back() -> None:
    world = build_world("sit_on_cushion", 0, _SIZE)
    (dent,) = world.room.dents
    soft = world.room.blocks[dent.block].soft
    assert 0.03 <= soft <= 0.08
    assert dent.depth.max() == pytest.approx(soft, abs=0.01)
    assert world.dent.max() == pytest.approx(soft, abs=0.01)
    sunk = world.dent[0] > 0.005
    assert world.contact[0, sunk & world.outer].all()  # in the flat cushion, on the dented one
    assert sunk[_part("torso")].any()
    # The photo shows the dent; the empty scene shows the flat seat.
    scene = ~world.masks.any(axis=0)
    assert (world.depth - world.empty_depth)[scene].max() > 0.005
    assert (world.depth >= world.empty_depth - 1e-5)[scene].all()
    seen = world.camera.to_room(world.points(people=True)[scene].astype(float))
    assert np.abs(world.room.signed_distance(seen)).max() < 0.004
    empty = world.camera.to_room(world.points(people=False).reshape(-1, 3).astype(float))
    assert np.abs(world.room.signed_distance(empty, dented=False)).max() < 1e-4


def test_a_ball_is_held_by_both_hands_and_is_not_in_the_empty_scene() -> None:
    world = build_world("hold_ball", 0, _SIZE)
    assert world.items == ("ball",)
    (ball,) = (block for block in world.room.blocks if block.item)
    distance = np.linalg.norm(
        world.camera.to_room(world.vertices.astype(float)) - np.array(ball.centre), axis=-1
    )
    apart = distance - ball.rounding
    np.testing.assert_array_equal(
        world.touched_item == 0, (apart <= CONTACT_DISTANCE) & world.outer
    )
    for side in ("left", "right"):
        assert abs(apart[0, _part(f"{side}_hand")].min()) < 0.002
    mask = world.item_masks[0]
    assert mask.any()
    assert not (mask & world.masks.any(axis=0)).any()
    assert (world.depth[mask] < world.empty_depth[mask]).all()
    seen = world.camera.to_room(world.points(people=True)[mask].astype(float))
    assert np.linalg.norm(seen - np.array(ball.centre), axis=1) == pytest.approx(
        ball.rounding, abs=0.003
    )
