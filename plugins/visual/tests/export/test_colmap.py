"""COLMAP: the binary model has the camera and the points of the result; its pixels are counted from
the corner.
"""

from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physic_core.errors import ConfigError
from physic_core.export import export_frame
from physic_core.geometry.world_frame import transform_points


class Model:
    """A model of one image, read field by field as COLMAP's page "Output format" lists them."""

    def __init__(self, folder):
        cameras, images, points = (
            (folder / f"{name}.bin").read_bytes() for name in ("cameras", "images", "points3D")
        )
        count, self.camera_id, self.model, *self.size = struct.unpack_from("<QiiQQ", cameras)
        assert count == 1
        self.params = struct.unpack_from("<4d", cameras, 32)
        count, self.image_id, *pose, camera_id = struct.unpack_from("<Qi7di", images)
        assert (count, camera_id) == (1, self.camera_id)
        self.rotation = Rotation.from_quat([*pose[1:4], pose[0]])
        self.translation = pose[4:]
        end = images.index(b"\0", 72)
        self.name = images[72:end].decode()
        (number,) = struct.unpack_from("<Q", images, end + 1)
        self.pixels = [
            struct.unpack_from("<ddq", images, end + 9 + 24 * place) for place in range(number)
        ]
        assert end + 9 + 24 * number == len(images)
        (number,) = struct.unpack_from("<Q", points)
        rows = [struct.unpack_from("<Q3d3BdQii", points, 8 + 59 * place) for place in range(number)]
        assert 8 + 59 * number == len(points)
        self.points = {row[0]: row for row in rows}


@pytest.fixture(params=["camera", "z", "y"])
def up(request):
    return request.param


def test_each_pixel_sees_its_point_which_is_that_of_the_result(export, result, tmp_path, up):
    export("", "colmap", up=up)
    model = Model(tmp_path / "sparse" / "0")
    camera = result.intrinsics
    assert (model.model, *model.size) == (1, camera.width, camera.height)
    assert model.params == (camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5)
    back = np.linalg.inv(export_frame(result.scene.floor, up).from_camera)
    assert len(model.pixels) == len(model.points) > 5000
    pixels = np.array([pixel[:2] for pixel in model.pixels])
    rows = [model.points[pixel[2]] for pixel in model.pixels]
    assert [row[9:] for row in rows] == [(model.image_id, place) for place in range(len(rows))]
    world = np.array([row[1:4] for row in rows])
    columns, lines = (pixels - 0.5).astype(int).T
    wanted = result.scene.points[lines, columns]
    assert np.abs(transform_points(back, world) - wanted).max() < 1e-6
    np.testing.assert_array_equal([row[4:7] for row in rows], result.scene.colors[lines, columns])
    in_camera = model.rotation.apply(world) + model.translation
    fx, fy, cx, cy = model.params
    projected = in_camera[:, :2] / in_camera[:, 2:] * [fx, fy] + [cx, cy]
    assert np.abs(projected - pixels).max() < 1e-3


def test_no_point_is_on_a_person_and_the_mask_of_the_photo_is_without_people(
    export, result, tmp_path
):
    export("", "colmap")
    model = Model(tmp_path / "sparse" / "0")
    people = np.any([person.mask for person in result.people], axis=0)
    columns, lines = np.array([pixel[:2] for pixel in model.pixels]).astype(int).T
    assert not people[lines, columns].any()
    assert cv2.imread(str(tmp_path / "images" / model.name)).shape == result.image.shape
    mask = cv2.imread(str(tmp_path / "masks" / f"{model.name}.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(mask, np.where(people, 0, 255))


def test_a_named_model_lies_beside_the_file_and_needs_colmaps_name(export, tmp_path):
    export("cameras.bin")
    assert (tmp_path / "points3D.bin").is_file()
    with pytest.raises(ConfigError, match="not a"):
        export("a.bin")
