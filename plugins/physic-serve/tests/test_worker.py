"""The worker process: what a photo that breaks it costs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from physic_serve.jobs import Job, Jobs
from physic_serve.settings import Limits
from physic_serve.worker import PHOTO_FILE, Message, Worker

STAND_IN = """
import os, signal, time
from physic_core import BackendError, InputError

def open_pipeline(config):
    if config == "refuse":
        raise BackendError("no weights")

    def reconstruct(task, progress):
        if (task.folder / "photo").read_bytes() in (b"late", b"early"):
            marker = task.folder.parent / "begun"
            if (task.folder / "photo").read_bytes() == b"early" or not marker.exists():
                marker.touch()
                os.kill(os.getpid(), signal.SIGKILL)
        progress("people", 0, 1)
        word = (task.folder / "photo").read_bytes().decode()
        if word == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if word == "exit":
            os._exit(7)
        if word == "hang":
            time.sleep(600)
        if word == "bad":
            raise InputError("the photo is broken")
        if word == "backend":
            raise BackendError("no answer")
        if word == "path":
            raise BackendError(f"cannot read {task.folder}")
        raise ValueError(f"a bug at {task.folder}")

    return reconstruct
"""


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Jobs]]:
    """Start a queue whose process runs the stand-in; a spawned process has the import path of its parent."""
    (tmp_path / "stand_in_of_pipeline.py").write_text(STAND_IN)
    monkeypatch.syspath_prepend(tmp_path)
    import stand_in_of_pipeline  # type: ignore[import-not-found]

    started: list[Jobs] = []

    def start(config: str = "", **limits: float) -> Jobs:
        folder = tmp_path / "results"
        folder.mkdir()
        open_worker = partial(Worker, config, stand_in_of_pipeline.open_pipeline)
        started.append(Jobs(folder, open_worker, Limits(**limits)))  # type: ignore[arg-type]
        started[-1].start()
        return started[-1]

    yield start
    for jobs in started:
        jobs.close()


def add(jobs: Jobs, word: str) -> Job:
    with jobs.new() as job:
        (job.folder / PHOTO_FILE).write_text(word)
    return job


def ended(job: Job) -> str:
    while not job.finished:
        time.sleep(0.02)
    return job.error


def test_a_photo_that_breaks_the_process_costs_itself_alone(start: Callable[..., Jobs]):
    jobs = start()
    added = [add(jobs, word) for word in ("kill", "bad", "backend", "path", "exit", "bug")]
    assert [ended(job) for job in added] == [
        "the process was ended by SIGKILL; often the memory is too small",
        "the photo is broken",
        "BackendError: no answer",
        "BackendError; the server's log has more",
        "the process ended with code 7",
        "an unexpected error (ValueError); the server's log has more",
    ]
    assert [job.stages for job in added] == [[("people", 0, 1)]] * 6
    assert jobs.wait_until_open() == ""


def test_a_photo_whose_process_ends_before_its_first_stage_is_tried_once_more(start: Callable[..., Jobs]):
    jobs = start()
    assert [ended(add(jobs, word)) for word in ("late", "early")] == [
        "an unexpected error (ValueError); the server's log has more",
        "the process was ended by SIGKILL; often the memory is too small",
    ]


def test_a_photo_that_takes_too_long_is_ended(start: Callable[..., Jobs]):
    jobs = start(job_s=0.5)
    assert ended(add(jobs, "hang")) == "no result after 0.5 s, the limit"


def test_models_that_cannot_be_loaded_are_reported(start: Callable[..., Jobs]):
    jobs = start("refuse")
    assert jobs.wait_until_open() == "the models cannot be loaded: BackendError: no weights"
    assert ended(add(jobs, "photo")) == "the models cannot be loaded; the server's log has more"


def test_a_message_can_be_sent_between_processes():
    import pickle

    assert pickle.loads(pickle.dumps(Message("stage", ("people", 0, 1)))) == Message("stage", ("people", 0, 1))
