"""A server without a model: its worker is scripted, or a process with a stand-in for the pipeline."""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from starlette.testclient import TestClient

from physic_serve.app import make_app
from physic_serve.jobs import Jobs
from physic_serve.settings import Limits
from physic_serve.worker import Message, Task


class ScriptedWorker:
    """In place of the process: each task waits for ``release``, then writes a file, or ends as ``outcome`` says."""

    def __init__(self) -> None:
        self.tasks: list[Task] = []
        self.release = threading.Event()
        self.outcome: Callable[[Task], Message] = self.write
        self.ended = False

    @property
    def alive(self) -> bool:
        return not self.ended

    def write(self, task: Task) -> Message:
        (task.folder / "preview.png").write_bytes(b"picture")
        (task.folder / "report.html").write_text("<p>report</p>")
        return Message("done", {"people": 2, "grade": "good"})

    def send(self, task: Task) -> None:
        self.tasks.append(task)

    def receive(self) -> Iterator[Message | None]:
        yield Message("ready")
        done = 0
        while not self.ended:
            if len(self.tasks) == done:
                yield None
                continue
            task = self.tasks[done]
            yield Message("stage", ("people", 0, 2))
            while not self.release.wait(0.01) and not self.ended:
                yield None
            yield Message("stage", ("scene", 1, 2))
            yield self.outcome(task)
            done += 1

    def end(self) -> None:
        self.ended = True


class Served:
    """Client, queue and the workers that have been started."""

    def __init__(self, folder: Path, limits: Limits) -> None:
        self.workers: list[ScriptedWorker] = []
        self.release = threading.Event()
        self.jobs = Jobs(folder, self._open, limits)
        self.jobs.start()
        self.app = make_app(self.jobs, frozenset({"testserver"}))
        self.client = TestClient(self.app, raise_server_exceptions=True)

    def _open(self) -> Any:
        self.workers.append(ScriptedWorker())
        self.workers[-1].release = self.release
        return self.workers[-1]

    def post(self, photo: bytes | None = None, **settings: Any) -> Any:
        return self.client.post("/reconstructions", content=PHOTO if photo is None else photo, **settings)

    def wait(self, name: str, *states: str) -> dict[str, Any]:
        """Wait until a job is in one of the states; the workers are told not to wait."""
        states = states or ("done", "failed")
        for _ in range(3000):
            found: dict[str, Any] = self.client.get(f"/reconstructions/{name}").json()
            if found["state"] in states:
                return found
            time.sleep(0.01)
        raise AssertionError(f"{name} is {found}")


def jpeg(width: int = 80, height: int = 80) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(np.zeros((height, width, 3), np.uint8)).save(buffer, "JPEG")
    return buffer.getvalue()


PHOTO = jpeg()


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., Served]]:
    """Start a server with these limits; ends with the test."""
    started: list[Served] = []

    def start(**limits: Any) -> Served:
        folder = tmp_path / f"results-{len(started)}"
        folder.mkdir()
        started.append(Served(folder, Limits(**limits)))
        return started[-1]

    yield start
    for served in started:
        served.release.set()
        served.jobs.close()
