"""Values in files, as the cache has them: what was written, or DamagedFileError."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fuzzing.target import Target
from physic_core.files.plain import DamagedFileError, read_value, write_value
from physic_core.types import DepthMap, Intrinsics

VALUE = DepthMap(
    np.arange(15, dtype=np.float32).reshape(5, 3),
    Intrinsics.from_focal(3, 3, 5, "é"),
    0.5,
    ("a", "NaN"),
)


def make_seeds(folder: Path) -> list[bytes]:
    for name in ("", "f"):
        write_value(folder / f"seed{name}.npz", VALUE, stored=name)
    return [path.read_bytes() for path in sorted(folder.glob("*.npz"))]


def attack(data: bytes, folder: Path) -> None:
    path = folder / "a.npz"
    path.write_bytes(data)
    try:
        found = read_value(path, [DepthMap])
    except DamagedFileError:
        return
    assert repr(found) == repr(VALUE)
    np.testing.assert_array_equal(found.depth, VALUE.depth)


TARGETS = [Target("archives", make_seeds, attack)]
