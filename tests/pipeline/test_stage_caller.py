"""StageCaller: who is loaded when, what is closed when, and what is said of a backend that
fails.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

from physic_core import interfaces
from physic_core.cache import digests
from physic_core.cache.results import ResultCache
from physic_core.configuration.resolve import ResolvedBackend
from physic_core.errors import (
    BackendError,
    InputError,
    NoPersonError,
    PhysicError,
)
from physic_core.interfaces import MetricDepthRequest
from physic_core.pipeline.stage_caller import StageCaller
from physic_core.types import DepthMap, Hints, People, Provenance

pytestmark = pytest.mark.quick

CODE = digests.CodeDigester()
SHAPE = (6, 8)
PHOTO = np.zeros((*SHAPE, 3), np.uint8)
REQUEST = MetricDepthRequest(PHOTO, Hints())


class Counting(interfaces.MetricDepth):
    """Writes down what happens to it."""

    events: ClassVar[list[str]] = []

    def __init__(self, name="a", fails_in="", error=None):
        super().__init__()
        self.name = name
        self.fails_in = fails_in
        self.error = error or RuntimeError("no")
        self.answer = DepthMap(np.ones(SHAPE, np.float32), notes=(f"from {name}",))

    def load(self, device="cpu"):
        self.note("load", f" on {device}")

    def infer(self, image, hints):
        self.note("infer")
        return self.answer

    def close(self):
        self.note("close")

    def fingerprint(self):
        if self.fails_in == "fingerprint":
            raise self.error
        return ""

    def note(self, event, more=""):
        self.events.append(f"{event} {self.name}{more}")
        if self.fails_in == event:
            raise self.error


LOADS = f"(tests/pipeline/test_stage_caller.py:{Counting.note.__code__.co_firstlineno + 3})"
"""The line in which a backend that fails in load, infer or close does so."""


@pytest.fixture(autouse=True)
def events(monkeypatch):
    monkeypatch.setattr(Counting, "events", [])
    monkeypatch.setattr(digests, "_STARTED", float("inf"))
    return Counting.events


@pytest.fixture(autouse=True)
def passed_the_kit(monkeypatch):
    """Backends that are not asked twice."""
    monkeypatch.setattr("physic_core.pipeline.stage_caller.has_passed_kit", lambda *_: True)


def resolved(backend):
    return ResolvedBackend(
        backend, Provenance("metric_depth", backend.name, "p", "my-dist", "1.0", {}, "")
    )


def ask(stages, backend, request=REQUEST, *, last=True):
    return stages.call_backend("depth", resolved(backend), request, last=last)


@pytest.mark.parametrize("low_memory", [True, False])
def test_a_used_backend_is_closed_after_its_last_call(events, low_memory):
    stages = StageCaller("cpu", 3, low_memory=low_memory, close_used=not low_memory)
    a = Counting("a")
    b = Counting("b")
    ask(stages, a, last=False)
    ask(stages, a)
    ask(stages, b)
    stages.close()
    of_a = ["load a on cpu", "infer a", "infer a", "close a"]
    assert events == [*of_a, "load b on cpu", "infer b", "close b"]


@pytest.mark.parametrize("event", ["load", "infer"])
@pytest.mark.parametrize("low_memory", [True, False])
def test_a_backend_that_fails_is_closed_too(events, event, low_memory):
    stages = StageCaller("cpu", 1, low_memory=low_memory)
    with pytest.raises(BackendError):
        ask(stages, Counting(fails_in=event))
    assert ("close a" in events) == low_memory
    stages.close()
    assert events[-1] == "close a"
    assert events.count("close a") == 1


TITLE = "metric_depth 'a' (my-dist 1.0), stage 'depth'"


class Own(PhysicError):
    def __init__(self, one, two):
        super().__init__(f"{one} and {two}")


class OwnExit(BaseException):
    pass


@pytest.mark.parametrize("event", ["load", "infer"])
@pytest.mark.parametrize(
    ("error", "kind", "message"),
    [
        (RuntimeError("no weights"), BackendError, f"{TITLE}: RuntimeError: no weights {LOADS}"),
        (SystemExit(3), BackendError, f"{TITLE}: SystemExit: 3 {LOADS}"),
        (OwnExit("x"), BackendError, f"{TITLE}: OwnExit: x {LOADS}"),
        (MemoryError(), BackendError, f"{TITLE}: MemoryError {LOADS}"),
        (InputError("the image is tiny"), InputError, f"{TITLE}: the image is tiny"),
        (NoPersonError("nobody"), NoPersonError, f"{TITLE}: nobody"),
        (Own(1, 2), BackendError, f"{TITLE}: 1 and 2"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else None,
)
def test_a_failure_names_interface_backend_distribution_and_stage(event, error, kind, message):
    stages = StageCaller("cpu", 1)
    with pytest.raises(kind) as caught:
        ask(stages, Counting(fails_in=event, error=error))
    assert type(caught.value) is kind
    assert str(caught.value) == message
    assert caught.value.__cause__ is error
    (record,) = stages.records
    assert (record.failed, record.cached) == (True, False)


@pytest.fixture
def run(tmp_path):
    """Begins another run with the same cache."""
    folder = tmp_path / "answers"
    return lambda: StageCaller("cpu", 1, cache=ResultCache(folder, 10**6, CODE))


class ReadsTheHole(Counting):
    """Reads one hint."""

    reads = ("hole",)


def test_a_changed_hint_costs_a_call_only_if_the_backend_reads_it(events, run):
    people = People(
        np.zeros((0, *SHAPE), bool), np.zeros((0, 4), np.float32), np.zeros(0, np.float32)
    )
    hole = np.ones(SHAPE, bool)
    for hints in (Hints(), Hints(people=people), Hints(people=people, hole=hole)):
        ask(run(), ReadsTheHole("one"), MetricDepthRequest(PHOTO, hints))
        ask(run(), Counting("all"), MetricDepthRequest(PHOTO, hints))
    assert [event for event in events if event.startswith("infer")] == [
        *("infer one", "infer all"),
        "infer all",
        *("infer one", "infer all"),
    ]


def test_a_fingerprint_that_fails_costs_the_cache_alone(run):
    stages = run()
    assert ask(stages, Counting(fails_in="fingerprint")).depth.all()
    (warning,) = stages.warnings
    assert warning.startswith("metric_depth 'a' (my-dist 1.0)")


def test_a_number_of_numpy_is_no_difference_of_two_calls(run, monkeypatch):
    monkeypatch.setattr("physic_core.pipeline.stage_caller.has_passed_kit", lambda *_: False)
    backend = Counting()
    backend.answer = DepthMap(np.ones(SHAPE, np.float32), scale_sigma=np.float32(0.1))
    stages = run()
    ask(stages, backend)
    assert stages.warnings == []


def test_failures_and_wrong_answers_are_not_kept(run):
    wrong = Counting()
    wrong.answer = DepthMap(np.ones((8, 6)))
    for backend in (Counting(fails_in="infer"), wrong):
        with pytest.raises(BackendError):
            ask(run(), backend)
    stages = run()
    ask(stages, Counting())
    assert not stages.records[0].cached


def test_a_cached_result_must_pass_the_check(events, run, tmp_path, monkeypatch):
    ask(run(), Counting())
    stages = run()
    (file,) = (tmp_path / "answers").iterdir()
    monkeypatch.setattr(
        interfaces.MetricDepth, "check", lambda *_: [] if "infer a" in events[2:] else ["x"]
    )
    once = ask(stages, Counting())
    assert once.depth.shape == SHAPE
    stages.close()
    assert events == ["load a on cpu", "infer a", "load a on cpu", "infer a", "close a"]
    assert str(file) in stages.notes[0]
