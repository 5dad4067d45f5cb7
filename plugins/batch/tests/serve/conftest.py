"""A server without a model: its worker is scripted."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from physic_serve.app import make_app
from physic_serve.jobs import Jobs
from physic_serve.worker import Message

PHOTO = b"\xff\xd8\xff a photo"


class ScriptedWorker:
    """In place of the process: each task waits for ``release``, then writes files, or ends as
    ``outcome`` says.
    """

    def __init__(self):
        self.tasks = []
        self.release = threading.Event()
        self.outcome = self.write
        self.alive = True

    def wait(self):
        """It is loaded at once."""

    def write(self, task):
        for name in ("preview.png", "report.html", "combined.glb", "other.ply"):
            (task.folder / name).write_text(name)
        usable = {"usable_pose": 0, "usable_place": 2, "usable_contact": 1, "usable_size": 3}
        missing = {"mjcf": "the result has no floor"}
        return Message("done", {"people": 3, **usable, "missing_exports": missing})

    def reconstruct(self, task):
        self.tasks.append(task)
        yield Message("stage", ("people", 0, 2))
        while not self.release.wait(0.01) and self.alive:
            pass
        yield self.outcome(task) if self.alive else Message("failed", "the process ended")

    def end(self):
        self.alive = False


class Served:
    """A browser, and the workers that have been started."""

    def __init__(self, folder):
        self.workers = []
        self.release = threading.Event()
        self.jobs = Jobs(folder, self._open)
        self.client = self.browser()

    def browser(self):
        example = Path(__file__)
        return TestClient(make_app(self.jobs, ("testserver", "[::1]"), {"an-example.jpg": example}))

    def _open(self):
        self.workers.append(ScriptedWorker())
        self.workers[-1].release = self.release
        return self.workers[-1]

    def post(self, name="photo.jpg", content=PHOTO, **settings):
        """Send a photo, and return the address of its page."""
        posted = self.client.post(
            "/jobs", files={"photo": (name, content)}, data=settings, follow_redirects=False
        )
        assert posted.status_code == 303
        return str(posted.headers["location"])

    def wait(self, page, text):
        """Wait until a page has a text, and return it."""
        while text not in (found := self.client.get(page).text):
            pass
        return found


@pytest.fixture
def served(tmp_path):
    """A server that ends with the test."""
    found = Served(tmp_path)
    yield found
    found.jobs.close()
