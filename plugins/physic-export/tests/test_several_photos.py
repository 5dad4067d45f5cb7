"""A result of several photos: files with all cameras, and labels of each photo."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh

from physic_core.geometry.upright import transform_points
from physic_core.visual.export.request import export_frame
from physic_core.visual.glb import glb_files


@pytest.fixture(scope="module")
def several(module_at):
    return module_at("tests/conftest.py").make_several_photos()


def expected_pixels(camera, points):
    spots = camera.to_camera(points) @ camera.intrinsics.matrix.T
    return spots[:, :2] / spots[:, 2:]


def test_each_camera_of_a_usd_file_projects_a_vertex_onto_its_pixel(export, several):
    pxr = pytest.importorskip("pxr")
    from pxr import Gf, Usd, UsdGeom

    assert pxr
    stage = Usd.Stage.Open(str(export("a.usda", of=several, skin="neutral").files[0]))
    matrix = export_frame(several.scene.floor, "z").from_camera
    vertices = several.people[1].vertices[::50].astype(np.float64)
    for name, camera in zip(("camera", "camera_1", "camera_2"), several.cameras, strict=True):
        frustum = UsdGeom.Camera.Get(stage, f"/physic/{name}").GetCamera().frustum
        projection = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
        seen = np.array([projection.Transform(Gf.Vec3d(*spot)) for spot in transform_points(matrix, vertices).tolist()])
        size = np.array([camera.intrinsics.width, camera.intrinsics.height])
        pixels = (seen[:, :2] * [1, -1] + 1) / 2 * size - 0.5
        np.testing.assert_allclose(pixels, expected_pixels(camera, vertices), atol=1e-2)


def test_each_camera_of_a_glb_file_looks_at_the_people(several):
    content = dict(glb_files(several, parts=False))["combined.glb"]
    tree = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    assert [camera["name"] for camera in tree["cameras"]] == ["0.jpg", "50.jpg", "-80.jpg"]
    matrix = export_frame(several.scene.floor, "y").from_camera
    joints = several.people[1].joints[:23].astype(np.float64)
    for name, camera in zip(("camera", "camera_1", "camera_2"), several.cameras, strict=True):
        node = next(node for node in tree["nodes"] if node["name"] == name)
        assert tree["cameras"][node["camera"]]["extras"]["size_px"] == [*camera.image.shape[1::-1]]
        x, y, z, w = node["rotation"]
        pose = trimesh.transformations.quaternion_matrix([w, x, y, z])
        pose[:3, 3] = node["translation"]
        seen = transform_points(np.linalg.inv(pose), transform_points(matrix, joints)) * [1, -1, -1]
        spots = seen @ camera.intrinsics.matrix.T
        np.testing.assert_allclose(spots[:, :2] / spots[:, 2:], expected_pixels(camera, joints), atol=1e-6)
