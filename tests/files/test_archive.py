"""Archives of arrays and a document: complete or refused."""

from __future__ import annotations

import json
import math
import pickle
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from physic_core.files.archive import DamagedFileError, join_arrays, read_archive, split_arrays, write_archive

ARRAYS = {
    "People.masks": np.random.default_rng(0).random((2, 30, 40)) > 0.5,
    "points": np.random.default_rng(1).normal(size=(5, 3)).astype(np.float32),
    "image": np.random.default_rng(2).integers(0, 255, (6, 5, 3), np.uint8),
    "none": np.zeros((0, 4), np.float32),
    "one": np.array(2.5),
}
DOCUMENT = {"answer": [1, 2.5, "é", None, True]}


@pytest.mark.parametrize("stored", ["", "iuf"])
def test_an_archive_reads_back_as_it_was_written(tmp_path: Path, stored: str):
    write_archive(tmp_path / "new" / "a.npz", ARRAYS, DOCUMENT, stored=stored)
    arrays, document = read_archive(tmp_path / "new" / "a.npz")
    assert document == DOCUMENT
    assert list(arrays) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert arrays[name].dtype == array.dtype
        np.testing.assert_array_equal(arrays[name], array)
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.npz"]


def test_arrays_are_compressed_but_for_the_kinds_that_are_stored(tmp_path: Path):
    sizes = {}
    for name, array in (("mask", np.zeros((500, 500), bool)), ("depth", np.zeros((500, 500), np.float32))):
        for stored in ("", "f"):
            write_archive(tmp_path / "a.npz", {name: array}, None, stored=stored)
            sizes[name, stored] = (tmp_path / "a.npz").stat().st_size / array.nbytes
    assert max(sizes["mask", ""], sizes["mask", "f"], sizes["depth", ""]) < 0.02
    assert sizes["depth", "f"] > 1


def test_every_flipped_byte_and_every_cut_is_noticed_or_harmless(tmp_path: Path):
    write_archive(tmp_path / "a.npz", {name: ARRAYS[name] for name in ("points", "image")}, DOCUMENT, stored="f")
    whole = (tmp_path / "a.npz").read_bytes()
    broken = tmp_path / "b.npz"
    refused = 0
    for i in range(0, len(whole), 3):
        broken.write_bytes(whole[:i] + bytes([whole[i] ^ (1 << i % 8)]) + whole[i + 1 :])
        try:
            arrays, document = read_archive(broken)
        except DamagedFileError:
            refused += 1
        else:
            assert document == DOCUMENT
            assert all(np.array_equal(arrays[name], ARRAYS[name]) for name in ("points", "image"))
        broken.write_bytes(whole[:i])
        with pytest.raises(DamagedFileError):
            read_archive(broken)
    assert refused > len(whole) / 6


def test_a_pickle_is_never_opened(tmp_path: Path):
    class Bomb:
        def __reduce__(self):
            return (pytest.fail, ("a pickle was opened",))

    np.savez(tmp_path / "a.npz", document=np.array([Bomb()], object))
    (tmp_path / "b.npz").write_bytes(pickle.dumps(Bomb()))
    for name in ("a.npz", "b.npz"):
        with pytest.raises(DamagedFileError):
            read_archive(tmp_path / name)


def test_a_file_that_is_not_there_is_not_damaged(tmp_path: Path):
    with pytest.raises(FileNotFoundError):
        read_archive(tmp_path / "a.npz")


@dataclass(frozen=True)
class Sample:
    values: tuple[float, ...]
    name: str


def test_numbers_that_json_cannot_write_are_not_confused_with_texts_of_their_names(tmp_path: Path):
    sample = Sample((math.nan, math.inf, -math.inf, np.float32(np.nan), 0.1), "NaN")
    write_archive(tmp_path / "a.npz", *split_arrays(sample))
    arrays, document = read_archive(tmp_path / "a.npz")
    json.dumps(document, allow_nan=False)
    read = join_arrays(arrays, document, (Sample,))
    assert repr(read) == repr(Sample((math.nan, math.inf, -math.inf, math.nan, 0.1), "NaN"))


def test_archives_that_wrote_nan_as_python_does_are_still_read():
    document = json.loads('{"class": "Sample", "fields": {"values": {"tuple": [NaN, -Infinity]}, "name": "a"}}')
    assert repr(join_arrays({}, document, (Sample,))) == repr(Sample((math.nan, -math.inf), "a"))


def test_equal_contents_make_equal_files(tmp_path: Path):
    for name in ("a.npz", "b.npz"):
        write_archive(tmp_path / name, ARRAYS, DOCUMENT)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
