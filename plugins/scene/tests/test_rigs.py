"""Cameras that other programs wrote are read with the places and pixels of these programs."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physic_core.errors import ConfigError, InputError
from physic_scene import read_calibration

RIGS = Path(__file__).parent / "rigs"
POINTS = json.loads((RIGS / "points.json").read_text())
"""By file and camera: points of the world and their pixels by the tool's own camera, in its own
convention: pose2sim 0.10.49, aniposelib 0.8.0, caliscope 0.11.8, pycolmap 4.2.1, nerfstudio 1.1.5.
"""
SIZES = [(1920, 1080), (1280, 720), (1280, 720)]
BY_NAME = [Path("left_0012.jpg"), Path("middle_0012.jpg"), Path("right_0012.jpg")]
BY_FOLDER = [Path(f"/data/{name}/0001.png") for name in ("left", "middle", "right")]
BY_NUMBER = [Path("cam_0.jpg"), Path("cam_1.jpg"), Path("cam_2.jpg")]


def pixels(camera, points):
    """Return the pixels of points of the rig, in metres, by OpenCV."""
    to_rig = camera.pose
    rotation = Rotation.from_matrix(to_rig[:3, :3]).inv()
    vector = rotation.as_rotvec()
    offset = -rotation.apply(to_rig[:3, 3])
    K = camera.lens.intrinsics.matrix
    distortion = np.array(camera.lens.distortion)
    return cv2.projectPoints(points.copy(), vector, offset, K, distortion)[0][:, 0]


def distance(a, b):
    return np.linalg.norm(a.pose[:3, 3] - b.pose[:3, 3])


def off_px(camera, rows, unit_m=1.0, half=0.0):
    """How far points of the rig are from the pixels that the tool gives them."""
    points, expected = np.split(np.array(rows), [3], axis=1)
    return np.abs(pixels(camera, points * unit_m) - (expected - half)).max()


@pytest.mark.parametrize(
    ("file", "photos", "unit_m", "half", "within_px"),
    [
        ("pose2sim.toml", BY_NAME, None, 0, 1e-6),
        ("anipose.toml", BY_NAME, 0.001, 0, 1e-6),
        ("caliscope.toml", BY_NUMBER, None, 0, 1e-6),
        ("caliscope_aniposelib.toml", BY_NUMBER, None, 0, 1e-6),
        ("colmap", BY_FOLDER, 1.0, 0.5, 1e-6),
        ("nerfstudio", BY_FOLDER[:2], 1.0, 0.5, 1e-3),  # whose rays are float32
    ],
)
def test_points_have_the_pixels_that_the_tool_gives_them(file, photos, unit_m, half, within_px):
    cameras = read_calibration(RIGS / file, photos, SIZES[: len(photos)], unit_m)
    rows = POINTS.get(file, POINTS["caliscope.toml"]).values()
    for camera, own in zip(cameras, rows, strict=True):
        assert off_px(camera, own, unit_m or 1.0, half) < within_px
    assert distance(*cameras[:2]) == pytest.approx(np.sqrt(2**2 + 0.5**2 + 0.3**2), rel=1e-6)


def test_a_photo_of_a_camera_without_a_size_has_its_principal_point_in_the_middle():
    for size in [(640, 360), (720, 1280), (1024, 576)]:
        with pytest.raises(InputError, match="middle"):
            read_calibration(RIGS / "easymocap", BY_FOLDER[1:2], [size])


def test_intrinsics_alone_have_no_pose(tmp_path):
    shutil.copy(RIGS / "easymocap" / "intri.yml", tmp_path)
    cameras = read_calibration(tmp_path / "intri.yml", BY_FOLDER, SIZES)
    assert [camera.pose for camera in cameras] == [None, None, None]


def turned(folder, turns):
    """Return the path of Caliscope's rig with another number of turns of the cameras 0 and 2."""
    text = (RIGS / "caliscope.toml").read_text()
    path = folder / "rig.toml"
    path.write_text(text.replace("rotation_count = 0", f"rotation_count = {turns}"))
    return path


@pytest.mark.parametrize("turns", [1, 3])
def test_an_upright_photo_of_a_turned_camera_has_the_turned_pixels(turns, tmp_path):
    (camera,) = read_calibration(turned(tmp_path, turns), BY_NUMBER[2:], [(720, 1280)])
    *points, x, y = np.array(POINTS["caliscope.toml"]["cam_2"]).T
    upright = (719 - y, x) if turns == 1 else (y, 1279 - x)
    assert off_px(camera, np.stack([*points, *upright], 1)) < 1e-6


def test_a_camera_that_stands_on_its_head_is_refused_as_the_size_does_not_tell(tmp_path):
    with pytest.raises(InputError, match="turned or not"):
        read_calibration(turned(tmp_path, 2), BY_NUMBER[2:], [(1280, 720)])


@pytest.mark.parametrize("file", ["colmap", "nerfstudio"])
def test_files_without_a_unit_need_one(file):
    with pytest.raises(ConfigError, match="camera-unit"):
        read_calibration(RIGS / file, BY_FOLDER[:2], SIZES[:2])


@pytest.mark.parametrize(
    "photos", [["a.png", "b.png", "c.png"], ["cam_1.png", "cam_2.png", "cam_3.png"]]
)
def test_cameras_are_taken_in_order_where_no_photo_has_a_name(photos):
    cameras = read_calibration(RIGS / "pose2sim.toml", [Path(photo) for photo in photos], SIZES)
    assert [camera.name for camera in cameras] == ["left", "middle", "right"]
    assert all(camera.by_order for camera in cameras)


def test_images_of_one_name_are_told_apart_by_their_folders():
    photos = [Path("/other/right/0001.jpg"), Path("/other/left/0001.jpg")]
    right, left = read_calibration(RIGS / "colmap", photos, [SIZES[2], SIZES[0]], 1.0)
    assert (right.name, left.name) == ("right/0001.jpg", "left/0001.jpg")
    with pytest.raises(InputError, match="no camera"):
        read_calibration(
            RIGS / "colmap", [Path("/a/0001.jpg"), Path("/b/0001.jpg")], SIZES[:2], 1.0
        )


def changed(folder, file, old, new):
    """Return the path of a copy of a file, with the other files of its folder, in which a text is
    another one.
    """
    for one in (RIGS / file).parent.glob("*.*"):
        text = one.read_text()
        (folder / one.name).write_text(
            text.replace(old, new) if one.name == Path(file).name else text
        )
    return folder / Path(file).name


@pytest.mark.parametrize(
    ("file", "old", "new", "word"),
    [
        ("anipose_fisheye.toml", "", "", "fisheye"),
        ("anipose.toml", '"right"', '"left"', "has left twice"),
        ("anipose.toml", "0.0,]\nrotation", "0.0, 0.2,]\nrotation", "distortion"),
        ("colmap/cameras.txt", "SIMPLE_RADIAL ", "SIMPLE_RADIAL_FISHEYE ", "SIMPLE_RADIAL_FISHEYE"),
        ("colmap/cameras.txt", " 0 0 0\n", " 0.1 0 0\n", "k4 = 0.1"),
        ("colmap/images.txt", "left/0001.jpg\n", "left/0001.jpg", "images.txt"),
        ("nerfstudio/transforms.json", '"OPENCV"', '"OPENCV_FISHEYE"', "OPENCV_FISHEYE"),
        ("nerfstudio/transforms.json", '"frames"', '"pictures"', "lacks 'frames'"),
        ("nerfstudio/transforms.json", '"k1"', '"is_fisheye": true, "k1"', "is_fisheye"),
        ("easymocap/intri.yml", "K_middle", "middle", "T_middle, middle"),
        ("easymocap/intri.yml", "dist_middle", "D_middle", "has D_middle"),
        ("easymocap/intri.yml", "  rows: 3", "  lines: 3", "K_left is not an OpenCV matrix"),
        ("easymocap/extri.yml", "\nR_", "\nRT_", "has RT_left"),
        ("pose2sim.toml", "distortions", "distortion", "has distortion"),
        ("anipose.toml", "[metadata]", "[units]", "has units"),
        ("caliscope.toml", "[cameras.0]", "unit = 1\n[cameras.0]", "has unit"),
        ("nerfstudio/transforms.json", '"k1"', '"s1": 0.1, "k1"', "s1 = 0.1"),
        ("nerfstudio/transforms.json", '"cx": 967.75', '"cx": true', "cx of images/left"),
        ("nerfstudio/transforms.json", '"k1"', '"distortion": [0.1], "k1"', "distortion"),
        ("easymocap/intri.yml", "1410.000000, ", "", "intri.yml"),
        ("easymocap/intri.yml", "K_middle", "K_left", "has K_left twice"),
        ("anipose.toml", "[metadata]", "[metadata]\nunits = 'mm'", "has units"),
        ("nerfstudio/transforms.json", '"frames"', '"fl_x": 9, "frames"', "fl_x differs"),
        ("nerfstudio/transforms.json", '"k1"', '"fl_x": 9, "k1"', "a key twice"),
        ("colmap/images.txt", "right/0001.jpg", "left/0001.jpg", "twice"),
    ],
)
def test_what_is_not_supported_or_damaged_is_named(file, old, new, word, tmp_path):
    photos = BY_FOLDER if "/" in file else BY_NAME
    with pytest.raises(InputError, match=word):
        read_calibration(changed(tmp_path, file, old, new), photos[1:2], SIZES[1:2], 1.0)


def test_a_binary_model_is_refused_with_the_command_that_converts_it(tmp_path):
    (tmp_path / "cameras.bin").write_bytes(bytes(8))
    for path in (tmp_path, tmp_path / "images.bin"):
        with pytest.raises(InputError, match="model_converter"):
            read_calibration(path, BY_FOLDER, SIZES, 1.0)


def test_cameras_in_millimetres_need_their_unit_before_any_photo_is_reconstructed():
    with pytest.raises(InputError, match="camera-unit"):
        read_calibration(RIGS / "anipose.toml", BY_NAME, SIZES)


@pytest.mark.parametrize("unit", ["nan", "0", "-1", "inf"])
@pytest.mark.parametrize("cameras", [[], ["--cameras", "rig.toml"]])
def test_a_length_of_the_unit_that_is_none_is_a_wrong_argument(unit, cameras, physic):
    arguments = ["scene", "a.jpg", "b.jpg", "-o", "out", "--camera-unit", unit, *cameras]
    assert physic(*arguments).exit_code == 2


@pytest.mark.parametrize("name", ["a.toml", "intri.yml", "transforms.json", "cameras.txt"])
def test_a_file_of_more_than_256_mb_is_not_read(tmp_path, name):
    with (tmp_path / name).open("wb") as file:
        file.truncate((1 << 28) + 1)
    with pytest.raises(InputError, match="more than"):
        read_calibration(tmp_path / name, BY_NAME, SIZES, 1.0)
