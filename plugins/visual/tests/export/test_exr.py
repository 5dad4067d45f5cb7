"""EXR: the depth of the result in metres, behind and on its people."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
import trimesh

OpenEXR = pytest.importorskip("OpenEXR")


@pytest.fixture(scope="module")
def files(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("exr") / "a.exr"
    return {file.name: file for file in result.export(str(path)).files}


def read(path):
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    assert set(channels) == {"Y", "Z"}
    np.testing.assert_array_equal(channels["Y"].pixels, channels["Z"].pixels)
    assert channels["Z"].pixels.dtype == np.float32
    return channels["Z"].pixels


def test_the_depth_of_the_scene_is_metres_and_1e10_where_it_is_unknown(files, result):
    scene = result.scene
    wanted = np.where(scene.valid, scene.points[..., 2], np.float32(1e10))
    np.testing.assert_array_equal(read(files["a.exr"]), wanted)
    stated = json.loads(files["a_camera.json"].read_text())["depth"]
    assert stated == {"file": "a.exr", "unit_m": 1.0, "unknown": 1e10, "along": "z"}


def test_people_are_in_front_of_the_scene_at_the_depth_of_their_skin(files, result, rays):
    behind = read(files["a.exr"])
    with_people = read(files["a_people.exr"])
    bodies = [person.mesh() for person in result.people]
    rays = rays.reshape(-1, 3)
    skin = trimesh.util.concatenate(bodies)
    caster = trimesh.ray.ray_pyembree.RayMeshIntersector(skin)
    places, hits, _ = caster.intersects_location(np.zeros_like(rays), rays, multiple_hits=False)
    wanted = behind.copy()
    wanted.flat[hits] = np.minimum(wanted.flat[hits], places[:, 2])
    assert (wanted < behind).mean() > 0.05
    same = np.isclose(with_people, wanted, atol=1e-3)
    assert same.mean() > 0.999  # an edge may be on either side


def test_the_mask_is_white_where_the_scene_is_inpainted(files, result):
    mask = cv2.imread(str(files["a_inpainted.png"]), cv2.IMREAD_UNCHANGED)
    same = (result.scene.colors == result.image).all(-1)
    np.testing.assert_array_equal(mask, np.where(same, 0, 255))
    assert 0 < (mask > 0).mean() < 1
