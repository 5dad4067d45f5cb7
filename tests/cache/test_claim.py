"""Only its user can write to the cache, and what others could have written is not read."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from physic_core.cache.folders import CACHES, claim_folder
from physic_core.cache.results import CacheKey, ResultCache
from physic_core.types import DepthMap

pytestmark = [
    pytest.mark.quick,
    pytest.mark.skipif(os.name != "posix", reason="this system has no modes of files"),
]

KEY = CacheKey("metric_depth-a-0.result.npz", {})
ANSWER = DepthMap(np.ones((6, 8), np.float32))


@pytest.fixture
def _no_umask():
    before = os.umask(0)
    yield
    os.umask(before)


def opened(root):
    cache = ResultCache.in_users_folder(1)
    assert cache is not None
    return cache


@pytest.mark.usefixtures("_no_umask")
def test_folders_and_files_are_for_their_user_alone_whatever_the_umask(root):
    opened(root).write(KEY, ANSWER)
    made = [root.parent, *root.parent.rglob("*")]
    assert {path.name: oct(path.stat().st_mode & 0o777) for path in made} == {
        "new": "0o700",
        "cache": "0o700",
        "results": "0o700",
        KEY.name: "0o600",
    }


@pytest.mark.parametrize("mode", [0o770, 0o707])
def test_a_folder_that_others_could_write_is_narrowed_and_emptied(root, mode, caplog):
    opened(root).write(KEY, ANSWER)
    for _, suffix in CACHES.values():
        (root / "results" / f"{KEY.name.partition('.')[0]}{suffix}").write_text("theirs")
    (root / "results" / "mine.txt").write_text("not theirs")
    (root / "results").chmod(mode)
    for _ in range(2):
        assert opened(root).read(KEY) is None
    assert [path.name for path in (root / "results").iterdir()] == ["mine.txt"]
    assert (root / "results").stat().st_mode & 0o777 == 0o700
    assert caplog.messages == [
        f"others could write to the cache in {root}: now only you can, and its content was "
        f"discarded"
    ]


def test_a_folder_that_stays_open_to_others_is_not_used(root, monkeypatch, caplog):
    """Some file systems of other operating systems have no modes."""
    root.mkdir(parents=True)
    root.chmod(0o777)
    monkeypatch.setattr(Path, "chmod", lambda path, mode: None)
    assert claim_folder(root) is None
    assert caplog.messages == [
        f"the cache in {root.parent} is not used, since others can write to it: "
        "name a folder of your own in PHYSIC_CACHE"
    ]


def test_the_cache_of_another_user_is_not_used(root, monkeypatch, caplog):
    opened(root).write(KEY, ANSWER)
    monkeypatch.setattr(os, "geteuid", lambda: root.stat().st_uid + 1)
    assert ResultCache.in_users_folder(1) is None
    assert claim_folder(root / "results") is None
    assert caplog.messages == [
        f"the cache in {root} is not used, since it belongs to another user: name a folder of "
        f"your own in PHYSIC_CACHE"
    ]
    assert (root / "results" / KEY.name).is_file()
