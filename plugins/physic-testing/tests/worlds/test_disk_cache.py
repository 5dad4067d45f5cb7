from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import pytest

from physic_testing.worlds import disk_cache
from physic_testing.worlds import world as worlds


@dataclass(frozen=True)
class Inner:
    table: np.ndarray
    number: float | None


@dataclass(frozen=True)
class Outer:
    inner: tuple[Inner, ...]
    words: dict[str, np.ndarray]
    name: str


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv(disk_cache.FOLDER_VARIABLE, str(tmp_path / "kept"))
    return tmp_path / "kept"


def thing(seed: int = 0) -> Outer:
    rng = np.random.default_rng(seed)
    inner = tuple(Inner(rng.normal(size=(k, 3)).astype(np.float32), rng.random()) for k in range(3))
    return Outer(
        (*inner, Inner(np.zeros(0, bool), None)), {"a": rng.integers(9, size=4)}, "a/b \u00e9"
    )


def assert_same(one: Outer, two: Outer) -> None:
    assert (one.name, [i.number for i in one.inner]) == (two.name, [i.number for i in two.inner])
    arrays = [[*(i.table for i in x.inner), x.words["a"]] for x in (one, two)]
    for a, b in zip(*arrays, strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


def test_a_thing_is_built_once_and_then_read(cache):
    built = []

    def build() -> Outer:
        built.append(1)
        return thing()

    for _ in range(3):
        assert_same(disk_cache.load_or_build("key", Outer, (Inner,), build), thing())
    assert len(built) == 1
    assert [path.name for path in cache.iterdir()] == ["key.npz"]


@pytest.mark.parametrize("damage", ["empty", "half", "flipped", "other class", "no document"])
def test_a_broken_file_is_built_anew(cache, damage):
    disk_cache.load_or_build("key", Outer, (Inner,), thing)
    path = cache / "key.npz"
    whole = path.read_bytes()
    if damage == "empty":
        path.write_bytes(b"")
    elif damage == "half":
        path.write_bytes(whole[: len(whole) // 2])
    elif damage == "flipped":
        path.write_bytes(whole[:60] + bytes(255 - b for b in whole[60:90]) + whole[90:])
    elif damage == "other class":
        disk_cache._save(cache, "key.npz", Inner(np.zeros(2), 1.0))
    else:
        np.savez(path, table=np.zeros(2))
    assert_same(disk_cache.load_or_build("key", Outer, (Inner,), lambda: thing(1)), thing(1))
    # repaired
    assert_same(disk_cache.load_or_build("key", Outer, (Inner,), lambda: thing(2)), thing(1))


def test_the_files_unused_for_longest_go_first(cache, monkeypatch):
    import os

    for i in range(4):
        disk_cache.load_or_build(f"key{i}", Outer, (Inner,), thing)
        os.utime(cache / f"key{i}.npz", (i, i))
    disk_cache.load_or_build("key0", Outer, (Inner,), thing)  # used: now the newest
    size = (cache / "key0.npz").stat().st_size
    monkeypatch.setattr(disk_cache, "MAX_BYTES", 3 * size)
    disk_cache.load_or_build("key4", Outer, (Inner,), thing)
    assert sorted(path.stem for path in cache.iterdir()) == ["key0", "key3", "key4"]


def test_a_kept_world_is_the_built_one_bit_for_bit(tmp_path, monkeypatch):
    ask = worlds._cached_world.__wrapped__
    built = ask("stand", 0, (64, 48))
    monkeypatch.setenv(disk_cache.FOLDER_VARIABLE, str(tmp_path))
    monkeypatch.setattr(worlds, "_build", lambda *_: built)
    assert ask("stand", 0, (64, 48)) is built
    monkeypatch.delattr(worlds, "_build")
    read = ask("stand", 0, (64, 48))
    for field in fields(built):
        a = getattr(built, field.name)
        b = getattr(read, field.name)
        if isinstance(a, np.ndarray):
            assert a.dtype == b.dtype
            np.testing.assert_array_equal(a, b, err_msg=field.name)
            assert not b.flags.writeable
    assert (built.room, built.intrinsics, built.action) == (read.room, read.intrinsics, read.action)
    np.testing.assert_array_equal(built.floor.normal, read.floor.normal)
    assert list(built.keypoints) == list(read.keypoints)
