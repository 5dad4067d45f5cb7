"""Whatever happens to a file of the cache, its answer is computed again and kept again, and no
other is given.
"""

from __future__ import annotations

import json
import os

import numpy as np
import pytest

from physic_core.cache.digests import Digester
from physic_core.cache.folders import CACHES
from physic_core.cache.results import CacheKey, ResultCache
from physic_core.types import DepthMap, Intrinsics

pytestmark = pytest.mark.quick

ASKED = CacheKey(f"metric_depth-flipped-0{CACHES['results'][1]}", {"interface": "metric_depth"})


def depth_map():
    """A small answer, so that many flips meet headers and names."""
    depth = np.random.default_rng(0).normal(3, 1, (18, 24)).astype(np.float32)
    return DepthMap(depth, Intrinsics.from_focal(30, 24, 18, "exif"), 0.1, ("a note",))


def truncated(path):
    path.write_bytes(path.read_bytes()[:-30])


def a_folder(path):
    path.unlink()
    path.mkdir()


def a_pipe(path):
    path.unlink()
    os.mkfifo(path)


def with_document(path, change):
    """Write an archive again with a changed document."""
    with np.load(path) as file:
        arrays = dict(file)
    document = json.dumps(change(json.loads(arrays["document"].tobytes()))).encode()
    np.savez(path, **arrays | {"document": np.frombuffer(document, np.uint8)})


def of_another_question(path):
    with_document(
        path, lambda document: document | {"name": path.name.replace("flipped-0", "flipped-1")}
    )


def of_another_class(path):
    with_document(path, lambda document: document | {"kind": "Hands"})


DAMAGES = [
    *(truncated, a_folder, of_another_question, of_another_class),
    *([a_pipe] if hasattr(os, "mkfifo") else []),
]


@pytest.mark.parametrize("damage", DAMAGES, ids=lambda damage: damage.__name__)
def test_a_damaged_file_is_dropped_and_made_anew(tmp_path, damage):
    cache = ResultCache(tmp_path, 1 << 30)
    answer = depth_map()
    cache.write(ASKED, answer)
    path = tmp_path / ASKED.name
    damage(path)
    assert cache.read(ASKED) is None
    (note,) = cache.notes
    assert note.startswith(
        f"discarded a damaged cache file, and computed its result again: {path} ("
    )
    assert list(tmp_path.iterdir()) == []
    cache.write(ASKED, answer)
    assert Digester().digest(cache.read(ASKED)) == Digester().digest(answer)


def test_a_folder_with_files_in_it_is_left_alone_and_named(tmp_path):
    cache = ResultCache(tmp_path, 1 << 30)
    path = tmp_path / ASKED.name
    path.mkdir()
    (path / "mine.txt").write_text("mine")
    assert cache.read(ASKED) is None
    (note,) = cache.notes
    assert note.startswith(
        f"cannot remove a damaged cache file: {path} (it is not a regular file): "
    )
    cache.write(ASKED, depth_map())
    assert "a result of a backend cannot be cached" in cache.notes[1]
    assert (path / "mine.txt").read_text() == "mine"
