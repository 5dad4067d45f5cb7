"""A bounded folder: the longest unused files go first, and nothing of others is touched."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from physic_core.cache.folders import LruFolder, cache_folder

pytestmark = pytest.mark.quick


def put(folder, name, size, age_s):
    path = folder / name
    path.write_bytes(bytes(size))
    os.utime(path, (time.time() - age_s,) * 2)
    return path


@pytest.fixture
def folder(tmp_path):
    for i in range(4):
        put(tmp_path, f"{i}.result.npz", 100, 50 - i)
    put(tmp_path, "reconstruction.npz", 1000, 99)
    put(tmp_path, "notes.txt", 1000, 99)
    return tmp_path


def cache_in(folder):
    return LruFolder(folder, ".result.npz")


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_files_are_listed_from_the_least_recently_used(folder):
    cache_in(folder).mark_used("0.result.npz")
    assert [(file.path.name, file.size) for file in cache_in(folder).files()] == [
        (f"{i}.result.npz", 100) for i in (1, 2, 3, 0)
    ]


@pytest.mark.parametrize(("limit", "left"), [(400, 4), (399, 3), (200, 2), (0, 0)])
def test_the_longest_unused_go_until_the_rest_fits(folder, limit, left):
    cache_in(folder).trim(limit)
    assert names(folder) == [
        *(f"{i}.result.npz" for i in range(4 - left, 4)),
        "notes.txt",
        "reconstruction.npz",
    ]


def test_files_of_a_dead_writer_are_deleted_and_those_of_a_live_one_stay(folder):
    put(folder, ".9.result.npz.0a.physic-part", 10, 4000)
    put(folder, ".8.result.npz.0b.physic-part", 10, 4)
    put(folder, ".scene.glb.0c.physic-part", 10, 4000)
    in_parts = folder / ".7.result.npz.0d.physic-part"
    in_parts.mkdir()
    put(in_parts, "part", 10, 4000)
    os.utime(in_parts, (0, 0))
    cache_in(folder).trim(1000)
    assert [name for name in names(folder) if name.startswith(".")] == [
        ".8.result.npz.0b.physic-part",
        ".scene.glb.0c.physic-part",
    ]


@pytest.mark.parametrize("word", ["off", "OFF", "0", "no", "False"])
def test_a_cache_can_be_switched_off(monkeypatch, word):
    monkeypatch.setenv("SWITCH", word)
    assert cache_folder("things", "SWITCH") is None


def test_the_folder_is_the_environments_the_users_or_the_systems(tmp_path, monkeypatch):
    monkeypatch.delenv("SWITCH", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder("things", "SWITCH") == tmp_path / "physic" / "things"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    found = cache_folder("things", "SWITCH")
    assert found is not None
    assert found.is_absolute()
    monkeypatch.setenv("SWITCH", "mine")
    assert cache_folder("things", "SWITCH") == Path("mine")
