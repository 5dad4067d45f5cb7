"""Archives of arrays and a document, as the cache has them: what was written, or DamagedFileError."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fuzzing.target import Target
from physic_core.files.archive import DamagedFileError, read_archive, write_archive

ARRAYS = {
    "points": np.arange(15, dtype=np.float32).reshape(5, 3),
    "masks": np.arange(40).reshape(5, 8) % 3 == 0,
    "empty": np.zeros((0, 4), np.float32),
}
DOCUMENT = {"names": ["a", "é", None], "numbers": [1, 2.5]}


def make_seeds(folder: Path) -> list[bytes]:
    for name in ("", "f"):
        write_archive(folder / f"seed{name}.npz", ARRAYS, DOCUMENT, stored=name)
    return [path.read_bytes() for path in sorted(folder.glob("*.npz"))]


def attack(data: bytes, folder: Path) -> None:
    path = folder / "a.npz"
    path.write_bytes(data)
    try:
        arrays, document = read_archive(path)
    except DamagedFileError:
        return
    assert document == DOCUMENT
    assert list(arrays) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert arrays[name].dtype == array.dtype
        np.testing.assert_array_equal(arrays[name], array)


TARGETS = [Target("archives", make_seeds, attack)]
