"""GLB files: metres, y up, standing on y = 0, outsides outside."""

from __future__ import annotations

import io
import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from physic_core.geometry.world_frame import transform_points, world_from_camera
from physic_core.types import Scene
from physic_visual.glb import combined_glb
from physic_visual.scene_mesh import mesh_scene


def tree_of(content):
    magic, version, length, size, kind = struct.unpack("<4sIII4s", content[:20])
    assert (magic, version, length, kind) == (b"glTF", 2, len(content), b"JSON")
    return json.loads(content[20 : 20 + size])


def opened(content):
    return trimesh.load_scene(io.BytesIO(content), file_type="glb")


@pytest.fixture
def content(reconstruction):
    return combined_glb(reconstruction)


def flat_scene(depth):
    height, width = depth.shape
    rows, columns = np.indices(depth.shape)
    rays = [(columns - width / 2) / 50, (rows - height / 2) / 50, np.ones(depth.shape)]
    points = np.stack(rays, -1) * depth[..., None]
    return Scene(
        points=points.astype(np.float32),
        normals=np.broadcast_to(np.float32([0, 0, -1]), points.shape),
        colors=np.zeros(points.shape, np.uint8),
        valid=np.isfinite(depth),
        floor=None,
        floor_points=np.zeros((0, 3), np.float32),
    )


def surface_of(depth):
    return mesh_scene(flat_scene(depth), 10.0)


def test_a_wall_becomes_one_sheet_that_faces_the_camera():
    surface = mesh_scene(flat_scene(np.full((12, 20), 3.0)), 10.0)
    assert len(surface.vertices) == 240
    assert len(surface.faces) == 2 * 11 * 19
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    assert_allclose(mesh.face_normals - [0, 0, -1], 0, atol=1e-6)
    assert mesh.area == pytest.approx(11 * 19 * (3 / 50) ** 2, rel=1e-5)


@pytest.mark.parametrize(("far", "normal"), [(4.0, -1), (3.4, -1), (3.4, 0)])
def test_an_edge_in_depth_is_cut_also_without_normals(far, normal):
    depth = np.full((10, 20), 3.0)
    depth[:, 10:] = far
    scene = flat_scene(depth)
    surface = mesh_scene(replace(scene, normals=normal * np.abs(scene.normals)), 10.0)
    assert len(surface.faces) == 2 * 9 * 18
    assert np.ptp(surface.vertices[surface.faces][..., 2], axis=1).max() == 0


def test_invalid_and_far_pixels_are_left_out():
    depth = np.full((10, 20), 3.0)
    depth[4, 4] = np.nan
    depth[7, 14] = 50.0
    surface = surface_of(depth)
    assert len(surface.vertices) == 198
    # Six triangles meet at a pixel.
    assert len(surface.faces) == 2 * 9 * 19 - 12


def test_a_floor_far_away_stays_whole(reconstruction):
    """Its rows step by more than the limit, but along the floor."""
    scene = reconstruction.scene
    surface = mesh_scene(scene, 20.0)
    heights = surface.vertices @ scene.floor.normal + scene.floor.offset
    steps = np.ptp(surface.vertices[surface.faces][..., 2], axis=1)
    on_floor = (np.abs(heights[surface.faces]) < 1e-3).all(1)
    assert steps[on_floor].max() > 0.1
    floor = np.abs(scene.points @ scene.floor.normal + scene.floor.offset) < 1e-3
    assert (heights < 1e-3).sum() > 0.98 * floor.sum()


def test_the_file_states_units_axes_and_colours_and_has_a_camera(content):
    extras = tree_of(content)["scenes"][0]["extras"]
    assert extras["units"] == "meters"
    assert "y up" in extras["axes"]
    assert extras["contact_colors"] == {"floor": [24, 140, 130]}
    assert tree_of(content)["nodes"][-1]["name"] == "camera"


def test_vertices_are_the_camera_s_under_the_stated_matrix(content, reconstruction):
    matrix = np.array(tree_of(content)["scenes"][0]["extras"]["world_from_camera"])
    assert_array_equal(matrix, world_from_camera(reconstruction.scene.floor))
    mesh = opened(content).geometry["person_1"]
    assert_allclose(
        mesh.vertices, transform_points(matrix, reconstruction.people[1].vertices), atol=1e-6
    )
    assert_array_equal(mesh.faces, reconstruction.faces)


def test_the_scene_stands_in_the_same_frame_and_shows_its_colours(content, reconstruction):
    mesh = opened(content).geometry["scene"]
    low = mesh.bounds[0]
    assert low[1] == pytest.approx(0.0, abs=1e-3)
    assert low[2] == pytest.approx(-5.0, abs=1e-3)  # the wall
    # The nearest mesh vertex to the middle of the box's lid is red, as that is.
    lid = np.argmin(np.linalg.norm(mesh.vertices - [0.85, 0.45, -3.1], axis=1))
    texture = np.asarray(mesh.visual.material.baseColorTexture)
    u, v = mesh.visual.uv[lid]
    height, width = texture.shape[:2]
    pixel = texture[round((1 - v) * height - 0.5), round(u * width - 0.5)]
    assert_allclose(pixel, [215, 120, 95], atol=12)
