"""Files of arrays: whole or refused."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from physic_core.cache import npz

ARRAYS = {
    "People.masks": np.random.default_rng(0).random((2, 30, 40)) > 0.5,
    "points": np.random.default_rng(1).normal(size=(5, 3)).astype(np.float32),
    "image": np.random.default_rng(2).integers(0, 255, (6, 5, 3), np.uint8),
    "none": np.zeros((0, 4), np.float32),
    "one": np.array(2.5),
}
DOCUMENT = {"answer": [1, 2.5, "é", None, True]}


@pytest.mark.parametrize("squeeze", [True, False])
def test_reading_undoes_writing(tmp_path: Path, squeeze: bool):
    npz.write(tmp_path / "new", "a.npz", ARRAYS, DOCUMENT, squeeze=squeeze)
    arrays, document = npz.read(tmp_path / "new" / "a.npz")
    assert document == DOCUMENT
    assert list(arrays) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert arrays[name].dtype == array.dtype
        np.testing.assert_array_equal(arrays[name], array)
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.npz"]


def test_masks_are_always_squeezed_and_numbers_only_on_request(tmp_path: Path):
    sizes = {}
    for name, array in (("mask", np.zeros((500, 500), bool)), ("depth", np.zeros((500, 500), np.float32))):
        for squeeze in (True, False):
            npz.write(tmp_path, "a.npz", {name: array}, None, squeeze=squeeze)
            sizes[name, squeeze] = (tmp_path / "a.npz").stat().st_size / array.nbytes
    assert max(sizes["mask", True], sizes["mask", False], sizes["depth", True]) < 0.02
    assert sizes["depth", False] > 1


def test_every_flipped_byte_and_every_cut_is_noticed_or_harmless(tmp_path: Path):
    npz.write(tmp_path, "a.npz", {name: ARRAYS[name] for name in ("points", "image")}, DOCUMENT, squeeze=False)
    whole = (tmp_path / "a.npz").read_bytes()
    broken = tmp_path / "b.npz"
    refused = 0
    for i in range(0, len(whole), 3):
        broken.write_bytes(whole[:i] + bytes([whole[i] ^ (1 << i % 8)]) + whole[i + 1 :])
        try:
            arrays, document = npz.read(broken)
        except npz.Damaged:
            refused += 1
        else:
            assert document == DOCUMENT
            assert all(np.array_equal(arrays[name], ARRAYS[name]) for name in ("points", "image"))
        broken.write_bytes(whole[:i])
        with pytest.raises(npz.Damaged):
            npz.read(broken)
    assert refused > len(whole) / 6


def test_a_pickle_is_never_opened(tmp_path: Path):
    class Bomb:
        def __reduce__(self):
            return (pytest.fail, ("a pickle was opened",))

    np.savez(tmp_path / "a.npz", document=np.array([Bomb()], object))
    (tmp_path / "b.npz").write_bytes(pickle.dumps(Bomb()))
    for name in ("a.npz", "b.npz"):
        with pytest.raises(npz.Damaged):
            npz.read(tmp_path / name)


def test_a_file_that_is_not_there_is_not_damaged(tmp_path: Path):
    with pytest.raises(FileNotFoundError):
        npz.read(tmp_path / "a.npz")
