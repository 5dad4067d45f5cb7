"""The file of calibrated cameras is read as it is, and each fault in it is named."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physic_core.errors import ConfigError, InputError
from physic_scene import read_calibration

K = [[900.0, 0.0, 319.5], [0.0, 905.0, 239.5], [0.0, 0.0, 1.0]]
TURN = Rotation.from_euler("xyz", [10.0, 40.0, -5.0], degrees=True)
TRANSLATION = np.array([0.3, -0.2, 4.0])
PHOTOS = ["left_0001.jpg", "right_0001.jpg"]
SIZES = [(640, 480), (640, 480)]


def camera_table(**changes):
    entries = {
        "size": [640, 480],
        "K": K,
        "distortion": [-0.1, 0.02, 0.001, -0.002],
        "R": TURN.as_matrix().tolist(),
        "t": TRANSLATION.tolist(),
        **changes,
    }
    return "[left]\n" + "".join(
        f"{name} = {json.dumps(value).replace('Infinity', 'inf')}\n"
        for name, value in entries.items()
        if value is not None
    )


@pytest.fixture
def read(tmp_path):
    """Return a function that reads a file with this text."""

    def read_text(text, photos=PHOTOS, unit_m=None):
        path = tmp_path / "rig.toml"
        path.write_text(text)
        return read_calibration(path, [Path(photo) for photo in photos], SIZES, unit_m)

    return read_text


def test_a_camera_of_the_file_is_that_of_its_photo(read):
    camera, other = read(camera_table())
    assert other is None
    intrinsics = camera.lens.intrinsics
    assert np.allclose(intrinsics.matrix, K)
    assert (intrinsics.width, intrinsics.height) == (640, 480)
    assert camera.lens.distortion == (-0.1, 0.02, 0.001, -0.002, 0.0)
    # A point of the rig is at R x + t in the frame of the camera.
    point = np.array([0.4, -1.0, 0.7])
    seen = TURN.as_matrix() @ point + TRANSLATION
    assert np.allclose(camera.pose[:3, :3] @ seen + camera.pose[:3, 3], point)


def test_a_camera_can_have_no_pose(read):
    camera, _ = read(camera_table(R=None, t=None))
    assert camera.pose is None


def test_the_unit_of_the_file_can_be_given(read):
    camera, _ = read(camera_table(), unit_m=0.001)
    assert np.linalg.norm(camera.pose[:3, 3]) == pytest.approx(np.linalg.norm(TRANSLATION) / 1000)
    with pytest.raises(ConfigError, match="unit"):
        read(camera_table(), unit_m=math.inf)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"size": [1920, 1080]}, "1920"),
        ({"size": None}, "left.size"),
        ({"K": np.transpose(K).tolist()}, "K should be"),
        ({"R": (-TURN.as_matrix()).tolist()}, "a rotation"),
        ({"t": None}, "R and t"),
        ({"t": [0, 0, math.inf]}, "left.t"),
        ({"K": [[10**400, 0, 320], [0, 905, 240], [0, 0, 1]]}, "left.K"),
        ({"distortion": [0.1, 0.2]}, "distortion should be"),
        ({"fisheye": True}, "left.fisheye"),
    ],
)
def test_each_fault_of_a_camera_is_named(changes, word, read):
    with pytest.raises(InputError, match=word):
        read(camera_table(**changes))


@pytest.mark.parametrize(
    ("photos", "words"),
    [
        (["a.jpg", "lefty.jpg"], r"no camera for a.jpg, lefty.jpg, but for left"),
        (["left_1.jpg", "left_2.jpg"], "several photos are of camera left"),
    ],
)
def test_each_camera_has_one_photo(photos, words, read):
    with pytest.raises(InputError, match=words):
        read(camera_table(), photos)


@pytest.mark.parametrize("text", ["[left", "left = 3", 3_000 * "["])
def test_an_unreadable_file_is_named(text, read):
    with pytest.raises(InputError, match=r"rig\.toml"):
        read(text)


@pytest.mark.parametrize(("path", "word"), [("no.toml", r"no\.toml"), (os.devnull, "regular file")])
def test_a_missing_file_and_a_device_are_named(path, word):
    with pytest.raises(InputError, match=word):
        read_calibration(Path(path), [Path(photo) for photo in PHOTOS], SIZES)


@pytest.mark.parametrize("name", ["Left", "LEFT", "lefft", "left1"])
def test_a_camera_with_nearly_the_name_of_a_photo_is_refused(read, name):
    right = camera_table().replace("[left]", "[right_0001]")
    with pytest.raises(InputError, match=f"camera {name} has no photo"):
        read(right + camera_table().replace("[left]", f"[{name}]"))


def test_a_camera_of_another_photo_is_left_out(read):
    camera, other = read(camera_table() + camera_table().replace("[left]", "[ceiling]"))
    assert camera is not None
    assert other is None


@pytest.mark.parametrize(
    "changes",
    [
        {"size": ["640", 480]},
        {"K": [["900", 0, 319], [0, 905, 239], [0, 0, 1]]},
    ],
)
def test_a_number_as_a_text_is_refused(read, changes):
    with pytest.raises(InputError, match="should be a"):
        read(camera_table(**changes))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('name = "left"', "name = true"),
        ("rotation = [0.0, 0.0, 0.1]", 'rotation = "5 deg"'),
    ],
)
def test_a_name_or_a_rotation_of_another_kind_is_refused(read, old, new):
    text = """
        [left]
        name = "left"
        size = [640, 480]
        matrix = [[900.0, 0.0, 319.5], [0.0, 905.0, 239.5], [0.0, 0.0, 1.0]]
        rotation = [0.0, 0.0, 0.1]
        translation = [0.0, 0.0, 0.0]
    """
    assert read(text)[0] is not None
    with pytest.raises(InputError):
        read(text.replace(old, new))
