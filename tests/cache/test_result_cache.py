"""Cached results: the same request to the same backend finds them again to the last bit, and no
other request does.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from pydantic import Field

from physic_core import interfaces
from physic_core.cache import digests
from physic_core.cache import results as module
from physic_core.cache.results import ResultCache
from physic_core.types import DepthMap, Hands, Hints, Intrinsics, Provenance

pytestmark = pytest.mark.quick


class Depth(interfaces.MetricDepth):
    class Options(interfaces.Options):
        weights: str = Field("small", description="name or file")

    stated = ""

    def infer(self, image, hints):
        return DepthMap(np.ones(image.shape[:2], np.float32))

    def fingerprint(self):
        return self.stated


WHO = Provenance(
    "metric_depth", "my depth/1", "my_plugin", "my-dist", "1.0", {"weights": "small"}, "MIT"
)
IMAGE = np.random.default_rng(0).integers(0, 255, (6, 8, 3), np.uint8)
INPUTS = (IMAGE, Hints(intrinsics=Intrinsics.from_focal(9, 8, 6)))
ANSWER = DepthMap(
    np.full((6, 8), np.nan, np.float32), Intrinsics.from_focal(9, 8, 6, "é"), 0.1, ("note", "two")
)


@pytest.fixture(autouse=True)
def _old_code(monkeypatch):
    """Files that are edited while the tests run count as older than this process."""
    monkeypatch.setattr(digests, "_STARTED", float("inf"))


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "results"


@pytest.fixture
def cache(folder):
    return ResultCache(folder, 10**6)


def ask(
    cache,
    who=WHO,
    device="cpu",
    inputs=INPUTS,
):
    question = cache.key(Depth(), who, device, inputs)
    assert question is not None
    return question


def files(folder):
    return sorted(folder.iterdir())


def test_another_run_reads_cached_results_bit_for_bit(cache, folder):
    assert cache.read(ask(cache)) is None
    cache.write(ask(cache), ANSWER)
    found = ResultCache(folder, 0).read(ask(cache))
    assert isinstance(found, DepthMap)
    assert found.depth.dtype == np.float32
    np.testing.assert_array_equal(found.depth, ANSWER.depth)
    assert replace(found, depth=ANSWER.depth) == ANSWER
    (file,) = files(folder)
    assert file.name.startswith("metric_depth-my_depth_1-")
    with np.load(file) as stored:
        assert json.loads(stored["document"].tobytes())["backend"]["distribution"] == "my-dist"


@pytest.mark.parametrize(
    "other",
    [
        {"who": replace(WHO, backend="other")},
        {"who": replace(WHO, version="1.1")},
        {"who": replace(WHO, options={"weights": "large"})},
        {"device": "cuda"},
        {"inputs": (IMAGE[::-1], INPUTS[1])},
        {"inputs": (IMAGE, Hints(intrinsics=Intrinsics.from_focal(9.0001, 8, 6)))},
    ],
    ids=str,
)
def test_another_input_has_another_cache_key(cache, other):
    assert ask(cache, **other).name != ask(cache).name


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [(interfaces.MetricDepth, "api", 99), (Depth, "stated", "revision 2")],
    ids=["version of the interface", "fingerprint of the backend"],
)
def test_what_a_class_states_is_part_of_the_cache_key(cache, monkeypatch, kind, name, value):
    before = ask(cache).name
    monkeypatch.setattr(kind, name, value)
    assert ask(cache).name != before


def test_the_version_of_a_library_is_part_of_the_cache_key(cache, folder, monkeypatch):
    versions = {"metricbody": {"numpy": "2.0"}, "my-dist": {"my-network": "1"}}
    names = []
    for distribution in ("none", "metricbody", "my-dist"):
        for library in versions.get(distribution, ()):
            versions[distribution][library] += ".1"
        monkeypatch.setattr(module, "required_versions", lambda name: dict(versions[name]))
        names.append(ask(ResultCache(folder, 1)).name)
    assert len(set(names)) == 3


def test_the_content_of_an_option_file_is_part_of_the_cache_key(cache, tmp_path):
    weights = tmp_path / "weights.pt"
    who = replace(
        WHO, options={"weights": str(weights), "more": [{"deep": str(weights)}], "odd": "\0"}
    )
    absent = ask(cache, who).name
    weights.write_text("1")
    before = ask(cache, who).name
    time = weights.stat().st_mtime_ns
    weights.write_text("2")
    os.utime(weights, ns=(time, time))
    assert len({absent, before, ask(cache, who).name}) == 3


def test_backends_that_are_not_cacheable_or_have_no_name_are_not_cached(cache, monkeypatch):
    class Local(Depth): ...

    assert cache.key(Local(), WHO, "cpu", INPUTS) is None
    assert cache.key(Depth(), WHO, "cpu", (IMAGE, {1})) is None
    monkeypatch.setattr(Depth, "cacheable", False)
    assert cache.key(Depth(), WHO, "cpu", INPUTS) is None


def test_a_disk_that_cannot_be_written_costs_one_note(tmp_path):
    (tmp_path / "file").write_text("")
    cache = ResultCache(tmp_path / "file", 10**6)
    for _ in range(2):
        cache.write(ask(cache), ANSWER)
        assert cache.read(ask(cache)) is None
    (note,) = cache.notes
    assert note.startswith("results of backends cannot be cached: ")
    assert note.endswith("; set PHYSIC_CACHE to another folder, or to off")
    cache.trim()
    assert (tmp_path / "file").read_text() == ""


def test_a_result_larger_than_the_whole_cache_is_not_written(tmp_path):
    cache = ResultCache(tmp_path / "results", 100)
    cache.write(ask(cache), ANSWER)
    assert not (tmp_path / "results").exists()


def test_the_run_that_wrote_makes_room(tmp_path):
    cache = ResultCache(tmp_path, 4000)
    for i in range(9):
        cache.write(ask(cache, replace(WHO, version=str(i))), ANSWER)
    ResultCache(tmp_path, 0).trim()  # wrote nothing
    assert len(files(tmp_path)) == 9
    cache.trim()
    assert 0 < sum(path.stat().st_size for path in files(tmp_path)) <= 4000


HAMMER = """
import sys
from pathlib import Path
import numpy as np
from physic_core.cache.results import ResultCache, CacheKey
from physic_core.types import Hands
cache = ResultCache(Path(sys.argv[1]), 40_000)
for i in range(120):
    k = i % 12
    question = CacheKey(f"hand_estimator-x-{k:040x}.result.npz", {})
    answer = cache.read(question)
    if answer is None:
        cache.write(question, Hands(np.full((2, 2, 15, 3), k, np.float32), np.ones((2, 2), np.float32)))
    else:
        assert (answer.rotvecs == k).all() and answer.rotvecs.shape == (2, 2, 15, 3)
    cache._written = True
    cache.trim()
print(cache.notes)
"""  # noqa: E501


def test_many_processes_may_read_write_and_make_room_at_once(tmp_path):
    running = [
        subprocess.Popen(
            [sys.executable, "-c", HAMMER, str(tmp_path)], stdout=subprocess.PIPE, text=True
        )
        for _ in range(3)
    ]
    assert [(process.communicate(timeout=300)[0], process.returncode) for process in running] == [
        ("[]\n", 0)
    ] * 3
    assert all(path.name.endswith(".result.npz") for path in tmp_path.iterdir())
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 40_000
    assert all(isinstance(answer, Hands) for answer in map(_answer, tmp_path.iterdir()))


def _answer(path):
    return ResultCache(path.parent, 0).read(module.CacheKey(path.name, {}))
