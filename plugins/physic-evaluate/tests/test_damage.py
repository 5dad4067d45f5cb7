"""Readers of results and of data sets on damaged content: an error that names the file, and never another exception."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physic_core.errors import InputError
from physic_evaluate.damage import DamagedFileError
from physic_evaluate.pickled import pickled_arrays
from physic_evaluate.readers import open_reader
from physic_evaluate.readers.base import ResultReader

from .miniatures import Files, K, write_plain
from .test_readers import POSE, STANDING, WRITERS, frame_of

Change = Callable[[Any], Any]
CHANGES: dict[str, Change] = {
    "missing": lambda value: KeyError,
    "NaN": lambda value: np.full(np.shape(value), np.nan),
    "text": lambda value: "a text",
    "one less": lambda value: np.ravel(value)[:-1],
    "empty": lambda value: np.zeros(0),
}


def leaves(values: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Keys of all entries of nested dictionaries, and of these."""
    for key, value in values.items():
        yield (*path, key)
        if isinstance(value, dict):
            yield from leaves(value, (*path, key))


def changed(values: Any, path: tuple[Any, ...], change: Change) -> Any:
    """A copy of nested dictionaries in which one entry is changed."""
    copy = dict(values)
    key, *rest = path
    new = changed(values[key], tuple(rest), change) if rest else change(values[key])
    if new is KeyError:
        del copy[key]
    else:
        copy[key] = new
    return copy


def write_parameters(folder: Path, files: Files, frame: Any) -> None:
    arrays = {name: np.array(value, np.float64)[None] for name, value in (STANDING | POSE).items()}
    write_plain(folder, frame.id, **arrays, K=K, contact=np.zeros((1, 10475)), boxes=np.zeros((1, 4)))


def write_sam(folder: Path, files: Files, frame: Any) -> None:
    rng = np.random.default_rng(1)
    arrays = {"pred_vertices": rng.uniform(-0.8, 0.8, (18439, 3)), "pred_keypoints_3d": rng.uniform(-1, 1, (70, 3))}
    write_plain(folder, frame.id, **arrays, pred_cam_t=np.array([0, 0, 4.0]), focal_length=480.0)


@pytest.mark.parametrize("name", [*WRITERS, "plain", "sam-3d-body"])
def test_a_reader_of_changed_content_gives_a_result_or_names_the_file(name: str, files: Files, tmp_path: Path):
    frame = frame_of()
    more = {"plain": write_parameters, "sam-3d-body": write_sam}
    (WRITERS | more)[name](tmp_path, files, frame)
    reader = open_reader(name, tmp_path, files.bodies)
    for file in sorted((*tmp_path.rglob("*.npz"), *tmp_path.rglob("*.pkl"))):
        content = file.read_bytes()
        values = dict(np.load(file)) if file.suffix == ".npz" else pickled_arrays(file)
        for path in leaves(values):
            for kind, change in CHANGES.items():
                new = changed(values, path, change)
                if file.suffix == ".npz":
                    np.savez(file, **new)
                else:
                    file.write_bytes(pickle.dumps(new))
                require_result_or_reason(reader, frame, file, f"{path} {kind}")
        for size in (0, 10, len(content) // 2, len(content) - 3):
            file.write_bytes(content[:size])
            with pytest.raises(DamagedFileError, match=file.name):
                reader.result(frame)
        file.write_bytes(content)


def require_result_or_reason(reader: ResultReader, frame: Any, file: Path, what: str) -> None:
    try:
        found = reader.result(frame)
    except InputError as error:
        found, reason = None, str(error)
    else:
        assert found is not None, what
        reason = str(file)
    assert str(file) in reason, what
    if found is None:
        return
    for person in found.people:
        assert person.vertices is None or np.isfinite(person.vertices).all(), what


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    """Two photos with one measured person each, and results."""
    from physic_evaluate.joints import LIMB_JOINTS

    rng, folder = np.random.default_rng(0), tmp_path / "mine"
    folder.mkdir()
    true = rng.uniform([-0.4, -0.9, 2.9], [0.4, 0.9, 3.1], (12, 3))
    joints = dict(zip(LIMB_JOINTS, true.tolist(), strict=True))
    record = {"width": 640, "height": 480, "K": K.tolist(), "joints": joints}
    for i in range(2):
        (folder / f"p{i}.png").write_bytes(b"")
        write_plain(tmp_path / "theirs", f"p{i}", joints=true[None], joint_names=np.array(LIMB_JOINTS))
    (folder / "truth.json").write_text(json.dumps([{"image": f"p{i}.png", **record} for i in range(2)]))
    return folder
