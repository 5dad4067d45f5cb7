"""Runs ahead of people: their outputs are those that backends ask for, and networks of one thread have none."""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physic_core import load_backend
from physic_core.cache.results import network_results_in
from physic_core.interfaces import Backend
from physic_core.io.photo import read_photo
from physic_core.types import Hints
from physic_embedded.networks.sessions import open_packaged_session

PHOTO = read_photo(Path(__file__).parents[3] / "examples" / "basketball.png").image


def run_ahead(backend: Backend) -> dict[str, Future[Any]]:
    begun: dict[str, Future[Any]] = {}
    with network_results_in(None, begun):
        for run in backend.prefetch(PHOTO):
            run()
    return begun


def test_the_segmenter_takes_its_encoding_of_the_photo(monkeypatch: pytest.MonkeyPatch) -> None:
    segmenter = load_backend("segmenter", "embedded", surfaces=False, tile_fractions=())
    expected = segmenter.infer(PHOTO)
    begun = run_ahead(segmenter)
    assert len(begun) == 1
    monkeypatch.setattr(segmenter.network["mobilesam_encoder"], "session", None)  # a second run would need it
    with network_results_in(None, begun):
        found = segmenter.infer(PHOTO)
    np.testing.assert_array_equal(found.masks, expected.masks)


def test_the_point_map_of_the_photo_takes_its_depth_and_that_of_the_scene_its_lines() -> None:
    estimator = load_backend("relative_pointmap", "embedded", short_side=98, photo_short_side=70)
    begun = run_ahead(estimator)
    ahead = set(begun)
    with network_results_in(None, begun):
        scene = estimator.infer(PHOTO, Hints(photo=PHOTO))
        assert len(set(begun) - ahead) == 1  # its own depth
        estimator.infer(PHOTO, Hints(scene=scene, intrinsics=scene.intrinsics))
    assert len(ahead) == 2
    assert len(begun) == 3


@pytest.mark.parametrize("interface", ["segmenter", "relative_pointmap"])
def test_networks_of_one_thread_run_one_after_another(interface: str) -> None:
    assert not load_backend(interface, "embedded", threads=1).prefetch(PHOTO)


def test_a_network_runs_for_one_thread_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    session, events = open_packaged_session("pose_detection"), list[str]()

    class Slow:
        def run(self, *_: object) -> tuple[()]:
            events.append("begins")
            time.sleep(0.05)
            events.append("ends")
            return ()

    monkeypatch.setattr(session, "session", Slow())
    with ThreadPoolExecutor(3) as threads:
        for run in [threads.submit(session.run, None, {}) for _ in range(3)]:
            run.result()
    assert events == ["begins", "ends"] * 3
