"""Files of calibrated cameras are read as they are, and each fault in them is named."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physic_core.errors import InputError
from physic_scene import read_calibration

K = [[900.0, 0.0, 319.5], [0.0, 905.0, 239.5], [0.0, 0.0, 1.0]]
DISTORTION = [-0.1, 0.02, 0.001, -0.002]
TURN = Rotation.from_euler("xyz", [10.0, 40.0, -5.0], degrees=True)
TRANSLATION = np.array([0.3, -0.2, 4.0])
PHOTOS = [Path("left_0001.jpg"), Path("right_0001.jpg")]
SIZES = [(640, 480), (640, 480)]


def own(**changes) -> str:
    entries = {"size": [640, 480], "K": K, "distortion": DISTORTION, "R": TURN.as_matrix().tolist()}
    entries |= {"t": TRANSLATION.tolist(), **changes}
    return "[left]\n" + "".join(
        f"{name} = {json.dumps(value)}\n" for name, value in entries.items() if value is not None
    )


def pose2sim() -> str:
    entries = {"name": "int_left_img", "size": [640.0, 480.0], "matrix": K, "distortions": DISTORTION}
    entries |= {"rotation": TURN.as_rotvec().tolist(), "translation": TRANSLATION.tolist(), "fisheye": False}
    lines = "".join(f"{name} = {json.dumps(value)}\n" for name, value in entries.items())
    return f"[int_left_img]\n{lines}\n[metadata]\nadjusted = false\nerror = 0.0\n"


def panoptic() -> str:
    camera = {"name": "left", "type": "hd", "resolution": [640, 480], "K": K, "distCoef": [*DISTORTION, 0.0]}
    camera |= {"R": TURN.as_matrix().tolist(), "t": (100 * TRANSLATION)[:, None].tolist()}
    return json.dumps({"calibDataSource": "x", "cameras": [camera]})


def colmap(folder: Path) -> Path:
    x, y, z, w = TURN.as_quat()
    translation = " ".join(map(str, TRANSLATION))
    (folder / "cameras.txt").write_text("# Camera list\n1 OPENCV 640 480 900 905 320 240 -0.1 0.02 0.001 -0.002\n")
    (folder / "images.txt").write_text(
        f"# Image list\n1 {w} {x} {y} {z} {translation} 1 some folder/left_0001.jpg\n1.5 2.5 -1 3 4 -1\n"
    )
    return folder


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("kind", ["own", "pose2sim", "panoptic", "colmap"])
def test_each_kind_of_file_gives_the_same_camera(kind, tmp_path):
    path = {
        "own": lambda: written(tmp_path, "rig.toml", own()),
        "pose2sim": lambda: written(tmp_path, "Calib.toml", pose2sim()),
        "panoptic": lambda: written(tmp_path, "calibration.json", panoptic()),
        "colmap": lambda: colmap(tmp_path),
    }[kind]()
    camera, other = read_calibration(path, PHOTOS, SIZES)
    assert other is None
    intrinsics = camera.lens.intrinsics
    assert np.allclose(intrinsics.matrix, K)
    assert (intrinsics.width, intrinsics.height) == (640, 480)
    assert camera.lens.distortion == pytest.approx((*DISTORTION, 0.0))
    # A point of the rig is at R x + t in the frame of the camera.
    point = np.array([0.4, -1.0, 0.7])
    seen = TURN.as_matrix() @ point + TRANSLATION
    assert np.allclose(camera.pose[:3, :3] @ seen + camera.pose[:3, 3], point)


def test_a_file_without_size_or_pose_takes_the_size_of_the_photo(tmp_path):
    path = written(tmp_path, "rig.toml", own(size=None, R=None, t=None))
    camera, _ = read_calibration(path, PHOTOS, SIZES)
    assert (camera.lens.intrinsics.width, camera.lens.intrinsics.height) == (640, 480)
    assert camera.pose is None


def test_the_unit_of_the_file_can_be_given(tmp_path):
    path = written(tmp_path, "rig.toml", own())
    camera, _ = read_calibration(path, PHOTOS, SIZES, 0.001)
    assert np.linalg.norm(camera.pose[:3, 3]) == pytest.approx(np.linalg.norm(TRANSLATION) / 1000)


def test_a_camera_of_a_longer_name_is_preferred_and_a_folder_names_one(tmp_path):
    text = own() + own().replace("[left]", "[left_0001]").replace("900.0", "950.0")
    path = written(tmp_path, "rig.toml", text)
    camera, other = read_calibration(path, [PHOTOS[0], Path("left/7.jpg")], SIZES)
    assert (camera.lens.intrinsics.fx, other.lens.intrinsics.fx) == (950.0, 900.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"size": [1920, 1080]}, "is of photos of 1920 x 1080 px, and left_0001.jpg has 640 x 480"),
        ({"K": None}, "has no K: give the matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], px"),
        ({"K": np.transpose(K).tolist()}, "K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], got"),
        ({"K": [[900, 4, 320], [0, 905, 240], [0, 0, 1]]}, "K has a skew of 4 px"),
        ({"R": (2 * TURN.as_matrix()).tolist()}, "R must be a rotation from the frame of the rig"),
        ({"R": (-TURN.as_matrix()).tolist()}, "it is a reflection"),
        ({"R": [1, 2]}, "R must have 3 or 9 numbers"),
        ({"t": None}, "t must have 3 numbers"),
        ({"distortion": [0.1, 0.2]}, "distortion must have 4 or 5 numbers"),
        ({"fisheye": True}, "is a fisheye"),
    ],
)
def test_each_fault_of_a_camera_is_named(changes, message, tmp_path):
    path = written(tmp_path, "rig.toml", own(**changes))
    with pytest.raises(InputError) as error:
        read_calibration(path, PHOTOS, SIZES)
    assert str(error.value).startswith(f"{path}, camera left")
    assert message in str(error.value)


def test_photos_without_a_camera_or_with_one_camera_for_two_are_named(tmp_path):
    path = written(tmp_path, "rig.toml", own())
    with pytest.raises(InputError) as error:
        read_calibration(path, [Path("a.jpg"), Path("lefty.jpg")], SIZES)
    assert str(error.value).startswith(f"{path} has no camera for a.jpg, lefty.jpg, but for left: the name of a photo")
    with pytest.raises(InputError, match=r"left_1.jpg and left_2.jpg are both photos of camera left"):
        read_calibration(path, [Path("left_1.jpg"), Path("left_2.jpg")], SIZES)


def test_an_unreadable_file_is_named(tmp_path):
    for name, text in (("no.toml", None), ("bad.toml", "[left"), ("bad.json", "{"), ("other.json", "[]")):
        path = tmp_path / name
        if text is not None:
            path.write_text(text)
        with pytest.raises(InputError) as error:
            read_calibration(path, PHOTOS, SIZES)
        assert str(path) in str(error.value)


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("rig.toml", own(t=[0, 0, 10**400]), "t must have 3 numbers"),
        ("rig.toml", own(K=[[10**400, 0, 320], [0, 905, 240], [0, 0, 1]]), "K must have 9 numbers"),
        ("rig.toml", own(t=[0, 0, 1e308]), "t must have 3 numbers"),
        ("rig.toml", own(R=[[1e308, 0, 0], [0, 1e308, 0], [0, 0, 1e308]]), "R must have 3 or 9 numbers"),
        ("rig.toml", "a = " + 3_000 * "[" + 3_000 * "]", "cannot read the cameras"),
        ("rig.json", 100_000 * "[" + 100_000 * "]", "cannot read the cameras"),
        ("rig.toml", "#" * (1 << 20) + own(), "more than 1,048,576"),
    ],
)
def test_numbers_beyond_every_camera_and_endless_files_are_refused(name, text, reason, tmp_path):
    with pytest.raises(InputError, match=reason):
        read_calibration(written(tmp_path, name, text), PHOTOS, SIZES)


@pytest.mark.parametrize("length", ["inf", "1e308", "nan"])
def test_a_camera_of_colmap_at_no_place_is_refused(length, tmp_path):
    folder = colmap(tmp_path)
    (folder / "images.txt").write_text(f"1 1 0 0 0 0 0 {length} 1 left_0001.jpg\n\n")
    with pytest.raises(InputError, match="no pose within 100000 m"):
        read_calibration(folder, PHOTOS, SIZES)


def test_a_device_is_no_file_of_cameras():
    with pytest.raises(InputError, match="/dev/zero"):
        read_calibration(Path("/dev/zero"), PHOTOS, SIZES)


def test_a_model_of_colmap_that_is_not_supported_is_named(tmp_path):
    folder = colmap(tmp_path)
    (folder / "cameras.txt").write_text("1 OPENCV_FISHEYE 640 480 1 1 1 1 0 0 0 0\n")
    with pytest.raises(InputError, match="camera 1 has model OPENCV_FISHEYE: undistort the photos"):
        read_calibration(folder, PHOTOS, SIZES)
