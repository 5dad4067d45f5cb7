"""Damaged and missing files of RICH, and files without permission: the reason names the file."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from physic_bench.contract import Picture
from physic_bench.damage import DamagedFrameError
from physic_bench.datasets.base import read_json
from physic_bench.datasets.rich import DATA_SET as RICH
from physic_bench.datasets.rich import RichOptions
from physic_bench.meshes import read_mesh
from physic_bench.pickled import pickled_arrays
from physic_bench.pictures import read_picture
from physic_bench.readers.base import archive_arrays
from physic_bench.validation import checked_truth

from .miniatures import Files, run
from .test_rich import SEQUENCE
from .test_rich import root as rich

__all__ = ["rich"]


def test_an_empty_folder_is_refused_before_anything_is_computed(files: Files, tmp_path: Path):
    (tmp_path / "set" / "bodies" / "test").mkdir(parents=True)
    done = run("rich", str(tmp_path / "set"), "-o", str(tmp_path / "out"), "--preset", "mock", *files.arguments())
    assert done.exit_code != 0
    assert "not complete for 'rich'" in done.output
    assert not (tmp_path / "out").exists()


def reasons(data_set: Any, root: Path, options: Any, files: Files) -> dict[str, str]:
    """Frame or sequence -> why it is not evaluated."""
    found = data_set.frames(root, options, files.bodies)
    left_out = dict(found.left_out)
    for frame in found.frames:
        try:
            checked_truth(frame)
        except DamagedFrameError as error:
            left_out[frame.id] = str(error)
    return left_out


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("</opencv_storage>", "", "{file} is not valid XML: it is damaged or truncated"),
        ("<Intrinsics><data>400.0", "<Intrinsics><data>wide", "{file}: Intrinsics holds no numbers"),
        ("<Intrinsics><data>400.0", "<Intrinsics><data>nan", "{file}: Intrinsics has values that are not finite"),
        ("<Intrinsics><data>400.0", "<Intrinsics><data>-400.0", "{file}: Intrinsics has no positive focal lengths and"),
        ("320.0", "20.0", "the picture {root}/images/test/"),
        ("<CameraMatrix><data>", "<CameraMatrix><data>5 ", "{file}: CameraMatrix must have 3 x 4 numbers, got 13"),
        ("<CameraMatrix><data>0.", "<CameraMatrix><data>-0.", "{file}: the rotation of CameraMatrix is not a rotation"),
        ("2.000000000", "2000.0", "{file}: the camera is 2000 m away: it must be metres"),
        ("-0.01 0.02 0 0 0", "-0.01", "{file}: Distortion must have 2 numbers or more, got 1"),
    ],
)
def test_a_damaged_calibration_of_rich_leaves_out_its_camera(
    rich: Path, files: Files, tmp_path: Path, old: str, new: str, reason: str
):
    root = Path(shutil.copytree(rich, tmp_path / "the set"))
    file = root / "scan_calibration/LectureHall_lunge/calibration/003.xml"
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    found = RICH.frames(root, RichOptions(), files.bodies)
    assert [frame.id for frame in found.frames] == [f"{SEQUENCE}/00042/0"]
    assert found.left_out[f"{SEQUENCE}/00042/3"].startswith(reason.format(file=file, root=root))


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("resource/gender.json", b"[]", "{file} must be an object of subjects, each of them one of neutral, male, f"),
        ("resource/gender.json", b'{"9": "male"}', "{file} has no subject 021"),
        (f"human_scene_contact/test/{SEQUENCE}/00042/009.pkl", b"", "{file} is not a complete pickle ("),
        (f"bodies/test/{SEQUENCE}/00042/009.pkl", b"cmine\nBody\n.", "{file} holds mine.Body, which is refused"),
        ("scan_calibration/LectureHall_lunge/scan_camcoord.ply", b"ply\n", "{file} cannot be read as a mesh: it is"),
    ],
)
def test_a_damaged_file_of_rich_is_the_reason_of_its_frames(
    rich: Path, files: Files, tmp_path: Path, name: str, content: bytes, reason: str
):
    root = Path(shutil.copytree(rich, tmp_path / "the set"))
    (root / name).write_bytes(content)
    found = reasons(RICH, root, RichOptions(), files)
    assert len(found) == 2
    assert all(text.startswith(reason.format(file=root / name)) for text in found.values())


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("a.npz", archive_arrays),
        ("a.pkl", pickled_arrays),
        ("a.json", read_json),
        ("a.ply", read_mesh),
        ("a.png", lambda path: read_picture(Picture(path))),
    ],
)
def test_a_file_without_permission_is_not_called_damaged(
    name: str, read: Callable[[Path], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    file = tmp_path / name
    file.write_bytes(b"")
    original = open

    def refused(path: Any, *arguments: Any, **options: Any) -> Any:
        """The operating system's answer to other users than root."""
        if str(path) == str(file):
            raise PermissionError(errno.EACCES, "Permission denied", str(file))
        return original(path, *arguments, **options)

    monkeypatch.setattr("builtins.open", refused)
    monkeypatch.setattr("io.open", refused)
    with pytest.raises(DamagedFrameError) as error:
        read(file)
    assert str(error.value).removeprefix("the picture ") == f"{file} cannot be read: Permission denied"
