"""Readers of results on damaged content: an error that names the file, and never another exception."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physic_bench.damage import DamagedFrameError
from physic_bench.readers import open_reader
from physic_bench.readers.base import ResultReader
from physic_core.errors import InputError

from .miniatures import Files, K, write_plain
from .test_readers import POSE, STANDING, frame_of, write_release

CHANGES: dict[str, Callable[[Any], Any] | None] = {
    "missing": None,
    "NaN": lambda value: np.full(np.shape(value), np.nan),
    "text": lambda value: "a text",
    "one less": lambda value: np.ravel(value)[:-1],
    "empty": lambda value: np.zeros(0),
}


def write_parameters(folder: Path, files: Files, frame: Any) -> None:
    arrays = {name: np.array(value, np.float64)[None] for name, value in (STANDING | POSE).items()}
    write_plain(folder, frame.id, **arrays, K=K, contact=np.zeros((1, 10475)))


@pytest.mark.parametrize(("name", "write"), [("physic-release", write_release), ("plain", write_parameters)])
def test_a_reader_of_changed_content_gives_a_result_or_names_the_file(
    name: str, write: Callable[..., None], files: Files, tmp_path: Path
):
    frame = frame_of()
    write(tmp_path, files, frame)
    reader = open_reader(name, tmp_path, files.bodies)
    (file,) = tmp_path.rglob("*.npz")
    content = file.read_bytes()
    with np.load(file) as values:
        arrays = dict(values)
    for array in arrays:
        for kind, change in CHANGES.items():
            new = {key: value for key, value in arrays.items() if key != array}
            np.savez(file, **new if change is None else new | {array: change(arrays[array])})
            require_result_or_reason(reader, frame, file, f"{array} {kind}")
    for size in (0, 10, len(content) // 2, len(content) - 3):
        file.write_bytes(content[:size])
        with pytest.raises(DamagedFrameError, match=file.name):
            reader.result(frame)


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
