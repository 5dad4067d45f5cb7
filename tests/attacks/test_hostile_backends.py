"""What a backend does to its process decides neither what ``physic`` does nor what it prints."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import hostile
from physic_core.batch.workers import WorkerSettings, run_in_workers
from physic_core.cli import main
from physic_core.configuration.resolve import ResolvedBackend
from physic_core.discovery.error_text import PluginExit
from physic_core.discovery.plugin_code import plugin_code
from physic_core.interfaces import MetricDepth, MetricDepthRequest
from physic_core.pipeline.stage_runner import StageRunner
from physic_core.types import DepthMap, Hints, Provenance


class Own(MetricDepth):
    """Calls a function with its input, and returns depths of 1 m."""

    def __init__(self, deed: Callable[[Any], Any]) -> None:
        super().__init__()
        self.deed = deed
        self.depth = np.ones((6, 8), np.float32)

    def infer(self, image: Any, hints: Hints) -> DepthMap:
        self.deed(image)
        return DepthMap(self.depth)


def call(deed: Callable[[Any], Any], image: np.ndarray | None = None) -> tuple[DepthMap, Own]:
    backend = Own(deed)
    resolved = ResolvedBackend(backend, Provenance("metric_depth", "own", "p", "my-dist", "1.0", {}, ""))
    request = MetricDepthRequest(np.zeros((6, 8, 3), np.uint8) if image is None else image, Hints())
    return StageRunner("cpu", 1).call_backend("depth", resolved, request), backend


def test_input_and_output_are_copies() -> None:
    image = np.zeros((6, 8, 3), np.uint8)
    result, backend = call(lambda given: given.fill(255), image)
    assert not image.any()
    backend.depth[:] = np.nan
    assert (result.depth == 1).all()


def test_plugin_exit_has_the_message_of_its_cause() -> None:
    with pytest.raises(PluginExit, match=r"^SystemExit: weights are missing$"), plugin_code():
        sys.exit("weights are missing")


# ---- calls that hang -------------------------------------------------------------------------------------------------


def test_a_worker_that_hangs_is_ended_and_the_others_go_on() -> None:
    outcomes = list(run_in_workers(hostile.HANGS, hostile.open_worker, WorkerSettings(2, timeout=1.0)))
    assert [outcome.failure for outcome in outcomes] == ["Timeout"] * len(hostile.HANGS)
    assert {outcome.message for outcome in outcomes} == {
        "no result, and no work for 1 s; --timeout sets the limit, and --retry failed tries the photo again"
    }


@pytest.mark.parametrize(
    ("name", "state", "message"),
    [("Printing", "ok", ""), ("Forging", "broken", "it ended Python with code 0: physic-doctor: ")],
)
def test_doctor_prints_what_it_found_itself(name: str, state: str, message: str) -> None:
    done = CliRunner().invoke(main, ["plugins", "doctor", f"hostile:{name}", "--json"])
    [found] = json.loads(done.stdout)
    assert found["state"] == state
    assert found["message"].startswith(message)
    assert done.exit_code == (0 if state == "ok" else 5)
