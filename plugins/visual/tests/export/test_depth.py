"""Depth and nerfstudio: the written pictures and cameras give the points of the result."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from physic_core.errors import ConfigError
from physic_core.export import export_frame
from physic_core.geometry.world_frame import transform_points


@pytest.fixture
def picture(tmp_path):
    """A function that reads a picture of an export."""
    return lambda name: cv2.imread(str(tmp_path / name), cv2.IMREAD_UNCHANGED)


def test_opencv_reads_the_points_of_the_scene_to_half_a_millimetre_and_masks_of_people(
    export, result, tmp_path, picture
):
    export("a.png")
    depth = picture("a.png")
    assert depth.dtype == np.uint16
    camera = json.loads((tmp_path / "a_camera.json").read_text())
    assert (camera["height"], camera["width"]) == depth.shape
    valid = result.scene.valid
    np.testing.assert_array_equal(depth > 0, valid)
    v, u = np.nonzero(valid)
    z = depth[valid] * camera["depth"]["unit_m"]
    points = np.stack(
        [(u - camera["cx"]) / camera["fx"] * z, (v - camera["cy"]) / camera["fy"] * z, z], 1
    )
    assert np.abs(points - result.scene.points[valid]).max() < 0.00051
    assert len(camera["masks"]) == len(result.people)
    for index, name in camera["masks"].items():
        np.testing.assert_array_equal(picture(name), 255 * result.people[int(index)].mask)


def test_what_16_bits_cannot_hold_is_unknown_and_said(export, result, picture):
    points = result.scene.points.copy()
    points[:12] *= 65.6 / points[:12, :, 2:]
    done = export("a.png", of=replace(result, scene=replace(result.scene, points=points)))
    depth = picture("a.png")
    assert not depth[:12].any()
    assert "65.535 m" in done.notes[-1]


@pytest.mark.parametrize("name", ["depth", "exr", "nerfstudio", "colmap"])
def test_depth_without_the_scene_is_refused(export, name):
    with pytest.raises(ConfigError, match="--no-scene"):
        export("a", name, scene=False)


@pytest.mark.parametrize("up", ["z", "y", "camera"])
def test_rays_of_nerfstudio_meet_the_points_of_the_scene_and_its_mask_leaves_people_out(
    export, result, tmp_path, picture, up
):
    export("a.json", "nerfstudio", up=up)
    data = json.loads((tmp_path / "a.json").read_text())
    (frame,) = data["frames"]
    depth = picture(frame["depth_file_path"])
    assert picture(frame["file_path"]).shape == (data["h"], data["w"], 3)
    people = np.any([person.mask for person in result.people], axis=0)
    np.testing.assert_array_equal(picture(frame["mask_path"]), np.where(people, 0, 255))
    valid = result.scene.valid
    v, u = np.nonzero(valid)
    z = depth[valid] * 0.001  # the default of nerfstudio's parsers
    assert data["depth_unit_scale_factor"] == 0.001
    # Nerfstudio's rays pass through pixel + 0.5; its cameras look along -z with y up.
    x = (u + 0.5 - data["cx"]) / data["fl_x"]
    y = (v + 0.5 - data["cy"]) / data["fl_y"]
    points = transform_points(np.array(frame["transform_matrix"]), np.stack([x * z, -y * z, -z], 1))
    back = transform_points(np.linalg.inv(export_frame(result.scene.floor, up).from_camera), points)
    assert np.abs(back - result.scene.points[valid]).max() < 0.00051
