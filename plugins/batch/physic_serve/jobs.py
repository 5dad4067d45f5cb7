"""The photos of a server, and the thread that gives them to the worker one by one."""

from __future__ import annotations

import os
import secrets
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from physic_core.files import paths_inside
from physic_serve.worker import Message, Task, Worker


@dataclass
class Job:
    """One photo and its result.

    Attributes:
        id: 128 random bits; whoever knows them can see the result.
        folder: of the result.
        title: name of the photo.
        state: "queued", "running", "done" or "failed".
        error: why it failed, or "".
        stages: name, number from 0 and count of each stage that has begun.
        summary: numbers of the result.
    """

    id: str
    folder: Path
    title: str
    state: str = "queued"
    error: str = ""
    stages: list[tuple[str, int, int]] = field(default_factory=list)
    summary: Mapping[str, Any] = field(default_factory=dict)

    @property
    def finished(self) -> bool:
        """Whether nothing more will happen."""
        return self.state in {"done", "failed"}

    @property
    def files(self) -> dict[str, Path]:
        """The files of the result by name; none before it is done, or if somebody has deleted
        them. A link that leads out is none of them.
        """
        if self.state == "done":
            with suppress(OSError):
                return paths_inside(self.folder, sorted(os.listdir(self.folder)))
        return {}

    @property
    def upload(self) -> Path:
        """Where the photo waits for its turn."""
        return self.folder.with_suffix(".upload")


class Jobs:
    """Reconstructs one photo at a time in a worker process; methods may be called from any thread.

    Args:
        folder: for the results, one folder each.
        open_worker: starts a worker process; at once, as everything else waits meanwhile.

    Raises:
        BackendError: the backends cannot be loaded.
    """

    def __init__(self, folder: Path, open_worker: Callable[[], Worker]) -> None:
        self._folder = folder
        self._open_worker = open_worker
        self._worker = open_worker()
        self._worker.wait()
        self._jobs: dict[str, Job] = {}
        self._waiting: SimpleQueue[tuple[Job, dict[str, float]] | None] = SimpleQueue()
        self._lock = threading.Lock()
        self._is_closed = False
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def add(self, photo: bytes, title: str, settings: dict[str, float]) -> Job:
        """Put a photo into the queue.

        Raises:
            OSError: the photo cannot be stored; nothing is left of it.
        """
        name = secrets.token_urlsafe(16)
        job = Job(name, self._folder / name, title)
        try:
            job.folder.mkdir()
            job.upload.write_bytes(photo)
        except OSError:
            with suppress(OSError):
                job.folder.rmdir()
                job.upload.unlink()
            raise
        self._jobs[name] = job
        self._waiting.put((job, settings))
        return job

    def get(self, name: str) -> Job | None:
        """Return a job, or None if there is none of this name."""
        return self._jobs.get(name)

    def stop(self, job: Job) -> None:
        """End a job that waits or runs."""
        with self._lock:
            if job.state == "running":
                self._worker.end()
            if not job.finished:
                job.state = "failed"
                job.error = "it was stopped"
                job.upload.unlink(missing_ok=True)

    def close(self) -> None:
        """End all jobs and the worker."""
        with self._lock:
            self._is_closed = True  # a job that waits opens no other worker
        for job in list(self._jobs.values()):
            self.stop(job)
        self._waiting.put(None)
        self._thread.join()
        self._worker.end()

    def _serve(self) -> None:
        while (item := self._waiting.get()) is not None:
            job, settings = item
            with self._lock:
                if job.finished or self._is_closed:
                    continue
                try:
                    if not self._worker.alive:
                        self._worker = self._open_worker()
                    task = Task(job.upload.read_bytes(), job.title, settings, job.folder)
                    job.upload.unlink()
                except OSError as error:
                    job.state = "failed"
                    job.error = str(error)
                    continue
                job.state = "running"
            for message in self._worker.reconstruct(task):
                self._apply_message(job, message)

    def _apply_message(self, job: Job, message: Message) -> None:
        with self._lock:
            if job.finished:
                return
            if message.kind == "stage":
                job.stages.append(message.content)
            elif message.kind == "done":
                job.state = "done"
                job.summary = message.content
            else:
                job.state = "failed"
                job.error = str(message.content)
