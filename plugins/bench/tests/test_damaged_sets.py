"""Damaged and missing files of RICH: the reason names the file, and costs its frames alone."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from physic_bench.data_files import (
    DamagedFrameError,
)
from physic_bench.datasets.base import FrameChoice
from physic_bench.datasets.rich import DATA_SET as RICH

from .miniatures import run
from .test_rich import SEQUENCE
from .test_rich import root as rich

__all__ = ["rich"]


def test_an_empty_folder_is_refused_before_anything_is_computed(files, tmp_path):
    (tmp_path / "set" / "bodies" / "test").mkdir(parents=True)
    places = (str(tmp_path / "set"), "-o", str(tmp_path / "out"))
    done = run("rich", *places, "--preset", "mock", *files.arguments())
    assert done.exit_code != 0
    assert "`physic evaluate rich --help`" in done.output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("</opencv_storage>", ""),
        ("<Intrinsics><data>400.0", "<Intrinsics><data>-400.0"),
        ("320.0", "20.0"),
        ("<CameraMatrix><data>0.", "<CameraMatrix><data>-0."),
    ],
)
def test_a_damaged_calibration_leaves_out_its_camera(rich, files, tmp_path, old, new):
    root = Path(shutil.copytree(rich, tmp_path / "the set"))
    file = root / "scan_calibration/LectureHall_lunge/calibration/003.xml"
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    frame_set = RICH.frames(root, FrameChoice(), files.bodies, "test")
    assert [frame.id for frame in frame_set.frames] == [f"{SEQUENCE}/00042/0"]
    assert str(file) in frame_set.left_out[f"{SEQUENCE}/00042/3"]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("resource/gender.json", b'{"9": "male"}'),
        (f"human_scene_contact/test/{SEQUENCE}/00042/009.pkl", b""),
        (f"bodies/test/{SEQUENCE}/00042/009.pkl", b"cmine\nBody\n."),
        ("scan_calibration/LectureHall_lunge/scan_camcoord.ply", b"ply\n"),
    ],
)
def test_a_damaged_file_is_the_reason_of_its_frames(rich, files, tmp_path, name, content):
    root = Path(shutil.copytree(rich, tmp_path / "the set"))
    (root / name).write_bytes(content)
    for frame in RICH.frames(root, FrameChoice(), files.bodies, "test").frames:
        with pytest.raises(DamagedFrameError, match=Path(name).name):
            frame.truth()
