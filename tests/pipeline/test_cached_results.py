"""A run that swaps one backend asks that one and those that depend on it, and loads no others.

The backends are those of the installed plugins; what happens to them is counted.
"""

from __future__ import annotations

import shutil
from collections import Counter

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from physic_core import Reconstruction, reconstruct
from physic_core.cache.digests import CodeDigester
from physic_core.cli import main
from physic_core.discovery.backends import list_backends, load_class
from physic_core.interfaces import INTERFACES
from physic_core.io.photo import read_photo
from physic_testing.worlds import load_world

pytestmark = pytest.mark.usefixtures("few_steps")

ONCE = Counter(list(INTERFACES))
EVERYBODY = ONCE + Counter(["relative_pointmap"])
"""How often a run asks each interface."""


class Counts:
    """What happened to the backends, by interface."""

    def __init__(self):
        self.asked = Counter()
        self.loaded = Counter()
        self.closed = Counter()
        self.open = set()
        self.most_open = 0


def count(patch):
    """Counts from now on what happens to every installed backend."""
    counts = Counts()
    for kind in dict.fromkeys(map(load_class, list_backends())):

        def infer(self, *arguments, _infer=kind.infer):
            counts.asked[self.interface] += 1
            return _infer(self, *arguments)

        def load(self, device="cpu", _load=kind.load):
            counts.loaded[self.interface] += 1
            counts.open.add(self.interface)
            counts.most_open = max(counts.most_open, len(counts.open))
            _load(self, device)

        def close(self, _close=kind.close):
            counts.closed[self.interface] += 1
            counts.open.discard(self.interface)
            _close(self)

        for name, method in (("infer", infer), ("load", load), ("close", close)):
            patch.setattr(kind, name, method)
    return counts


@pytest.fixture
def counts(monkeypatch):
    return count(monkeypatch)


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    path = tmp_path_factory.mktemp("photo") / "stand.png"
    Image.fromarray(load_world("stand", (160, 120)).image).save(path)
    return path


@pytest.fixture(scope="module", autouse=True)
def _same_code():
    """Files may be edited while these tests run: tests/cache/test_code.py sees to those."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CodeDigester, "digest", lambda self, kind: "the same")
        yield


@pytest.fixture(scope="module")
def first(few_steps, photo, tmp_path_factory):
    """The first run, of the preset mock: its cache, its result, and what happened."""
    folder = tmp_path_factory.mktemp("first")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PHYSIC_CACHE", str(folder))
        counts = count(patch)
        return folder, reconstruct(read_photo(photo).image, "mock"), counts


@pytest.fixture
def warm(first, tmp_path, monkeypatch):
    """The folder of answers in a copy of the cache that the first run left."""
    folder = tmp_path / "cache"
    shutil.copytree(first[0], folder)
    monkeypatch.setenv("PHYSIC_CACHE", str(folder))
    return folder / "results"


def by_set(photo, folder, swap):
    """The swap by --set, on the command line."""
    sets = [
        word for name, backend in swap.items() for word in ("--set", f"{name}.backend={backend}")
    ]
    physic("run", str(photo), "--preset", "mock", *sets, "-o", str(folder / "out"))


def physic(*arguments):
    done = CliRunner().invoke(main, [*arguments, "--save", "numbers"])
    assert done.exit_code == 0, done.output
    return done.stdout


def test_a_first_run_calls_loads_and_closes_every_backend(first):
    _, result, counts = first
    assert counts.asked == EVERYBODY
    assert counts.loaded == counts.closed == ONCE
    assert not any(stage.cached for stage in result.stages)
    assert any(stage.load_seconds for stage in result.stages)


def test_the_same_run_again_calls_and_loads_no_backend_and_gives_the_same_bits(
    first, warm, counts, photo, tmp_path
):
    again = reconstruct(read_photo(photo).image, "mock")
    assert (counts.asked, counts.loaded, counts.closed) == (Counter(), Counter(), Counter())
    assert [s.cached for s in again.stages] == [s.provenance is not None for s in again.stages]
    assert not any(s.failed or s.load_seconds for s in again.stages)
    for name in ("warnings", "notes", "checks"):
        assert getattr(again, name) == getattr(first[1], name)
    for name, result in (("first", first[1]), ("again", again)):
        result.save(str(tmp_path / name), "numbers")
    with (
        np.load(tmp_path / "first" / "reconstruction.npz") as one,
        np.load(tmp_path / "again" / "reconstruction.npz") as other,
    ):
        for name in set(one) - {"run"}:
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)


DEPENDENTS = [
    ({"metric_depth": "embedded"}, {"metric_depth": 1}),
    ({"contact_prior": "embedded"}, {"contact_prior": 1}),
    # Fingers are part of the bodies, which the contact prior and the metric depth are shown.
    ({"hand_estimator": "embedded"}, {"hand_estimator": 1, "contact_prior": 1, "metric_depth": 1}),
    # Two are shown the picture without people. The mock's point map is the true one whatever was
    # painted, so that those who are shown only that are not asked again.
    ({"inpainter": "telea"}, {"inpainter": 1, "relative_pointmap": 1, "metric_depth": 1}),
]


@pytest.mark.parametrize(("swap", "asked"), DEPENDENTS, ids=lambda value: next(iter(value)))
def test_swapping_a_backend_calls_it_and_what_depends_on_it(
    warm,
    counts,
    photo,
    tmp_path,
    swap,
    asked,
):
    by_set(photo, tmp_path, swap)
    assert counts.asked == Counter(asked)
    assert counts.loaded == Counter(dict.fromkeys(asked, 1))
    result = Reconstruction.load(str(tmp_path / "out"))
    assert (
        Counter(s.provenance.interface for s in result.stages if s.provenance and not s.cached)
        == asked
    )


def test_without_the_cache_every_backend_is_called_and_nothing_is_kept(
    warm, counts, photo, tmp_path
):
    before = {path: path.stat().st_mtime_ns for path in warm.iterdir()}
    said = physic("run", str(photo), "--preset", "mock", "--no-cache", "-o", str(tmp_path / "out"))
    assert counts.asked == EVERYBODY
    assert "the cache" not in said
    assert {path: path.stat().st_mtime_ns for path in warm.iterdir()} == before


def test_where_memory_is_short_one_backend_is_open_at_a_time(first, counts, photo, tmp_path):
    assert first[2].most_open == 1
    physic("run", str(photo), "--preset", "mock", "--low-memory", "-o", str(tmp_path / "out"))
    assert counts.loaded == counts.closed == ONCE
    assert counts.most_open == 1
    assert counts.open == set()
    low = Reconstruction.load(str(tmp_path / "out"))
    np.testing.assert_allclose(low.people[0].vertices, first[1].people[0].vertices, atol=4e-5)
