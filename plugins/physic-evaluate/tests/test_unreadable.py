"""Files without permission and empty folders: a reason per frame, or a refusal before anything is computed."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physic_evaluate.contract import Picture
from physic_evaluate.damage import DamagedFileError
from physic_evaluate.datasets.base import read_json
from physic_evaluate.datasets.damon import DATA_SET as DAMON
from physic_evaluate.datasets.damon import DamonOptions
from physic_evaluate.datasets.emdb import DATA_SET as EMDB
from physic_evaluate.datasets.emdb import EmdbOptions
from physic_evaluate.datasets.rich import DATA_SET as RICH
from physic_evaluate.datasets.rich import RichOptions
from physic_evaluate.meshes import read_mesh
from physic_evaluate.pickled import pickled_arrays
from physic_evaluate.pictures import read_picture
from physic_evaluate.readers.base import archive_arrays

from .miniatures import Files, run
from .test_damon_and_emdb import damon, emdb
from .test_rich import SEQUENCE
from .test_rich import root as rich

__all__ = ["damon", "emdb", "rich"]


@pytest.fixture
def forbid(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], None]:
    """Refuse to open a file, as the operating system does for other users than root."""
    refused: set[str] = set()
    original = open

    def checked(file: Any, *arguments: Any, **options: Any) -> Any:
        if str(file) in refused:
            raise PermissionError(13, "Permission denied", str(file))
        return original(file, *arguments, **options)

    monkeypatch.setattr("builtins.open", checked)
    monkeypatch.setattr("io.open", checked)
    return lambda path: refused.add(str(path))


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
    name: str, read: Callable[[Path], Any], tmp_path: Path, forbid: Callable[[Path], None]
):
    file = tmp_path / name
    file.write_bytes(b"")
    forbid(file)
    with pytest.raises(DamagedFileError) as error:
        read(file)
    assert str(error.value).removeprefix("the picture ") == f"{file} cannot be read: Permission denied"


def test_files_of_rich_without_permission_cost_their_frames(rich: Path, files: Files, forbid: Callable[[Path], None]):
    forbid(rich / "scan_calibration" / "LectureHall_lunge" / "calibration" / "003.xml")
    forbid(rich / "images" / "test" / SEQUENCE / "cam_00" / "00042_00.png")
    assert RICH.frames(rich, RichOptions(), files.bodies).left_out == {
        f"{SEQUENCE}/00042/0": f"the picture {rich}/images/test/{SEQUENCE}/cam_00/00042_00.png cannot be read: "
        "Permission denied",
        f"{SEQUENCE}/00042/3": f"{rich}/scan_calibration/LectureHall_lunge/calibration/003.xml cannot be read: "
        "Permission denied",
    }


def test_labels_of_damon_without_permission_are_refused(
    damon: tuple[Path, np.ndarray], files: Files, forbid: Callable[[Path], None]
):
    file = damon[0] / "Release_Datasets" / "damon" / "hot_dca_test.npz"
    forbid(file)
    with pytest.raises(DamagedFileError, match="cannot be read: Permission denied"):
        DAMON.frames(damon[0], DamonOptions(), files.bodies)


@pytest.mark.parametrize("name", ["rich", "emdb", "damon"])
def test_an_empty_folder_is_refused_with_a_list_of_what_is_missing(name: str, files: Files, tmp_path: Path):
    for folder in ("bodies/test", "P0/0", "Release_Datasets/damon"):
        (tmp_path / "set" / folder).mkdir(parents=True)
    done = run(name, str(tmp_path / "set"), "-o", str(tmp_path / "out"), "--preset", "mock", *files.arguments())
    assert done.exit_code != 0
    assert f"{tmp_path / 'set'} is not complete for '{name}'" in done.output
    assert not (tmp_path / "out").exists()


def test_empty_folders_of_rich_and_emdb_are_left_out_with_their_reason(
    rich: Path, emdb: Path, files: Files, tmp_path: Path
):
    root = Path(shutil.copytree(rich, tmp_path / "rich"))
    bodies = root / "bodies" / "test"
    (bodies / "Gym_010_pushup1").mkdir()
    (bodies / "Pavallion_003_yoga1" / "00001").mkdir(parents=True)
    (bodies / SEQUENCE / "00043").mkdir()
    left_out = RICH.frames(root, RichOptions(), files.bodies).left_out
    assert left_out == {
        "Gym_010_pushup1": f"there is no frame in {bodies / 'Gym_010_pushup1'}",
        "Pavallion_003_yoga1": f"there is no calibration of a camera in {root}/scan_calibration/Pavallion/calibration",
        **{f"{SEQUENCE}/00043/{view}": f"there is no body in {bodies / SEQUENCE / '00043'}" for view in (0, 3)},
    }
    shutil.copytree(emdb, tmp_path / "emdb")
    empty = tmp_path / "emdb" / "P3" / "30_empty"
    empty.mkdir(parents=True)
    found = EMDB.frames(tmp_path / "emdb", EmdbOptions(every=40), files.bodies)
    assert found.left_out == {"P3/30_empty": f"there is no file {empty}/*_data.pkl"}
    assert len(found.frames) == 1
