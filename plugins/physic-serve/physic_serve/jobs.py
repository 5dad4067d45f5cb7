"""The queue: which photos wait, run and are finished, and the thread that gives them to the worker one by one."""

from __future__ import annotations

import logging
import secrets
import shutil
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from physic_serve.settings import Limits
from physic_serve.worker import PHOTO_FILE, Message, Task, Worker

_LOG = logging.getLogger("physic_serve")
_EVERY_S = 1.0  # between two searches for old results, and for the end of an idle worker
_PAUSE_S = 5.0  # before a worker is opened again that could not be opened


class QueueFull(Exception):
    """Raised if too many photos wait; ``retry_s`` is a guess of when to try again."""

    def __init__(self, retry_s: int) -> None:
        super().__init__(f"the queue is full: try again in {retry_s} s")
        self.retry_s = retry_s


@dataclass
class Job:
    """One photo, from the upload until it is deleted.

    Attributes:
        id: 128 random bits; whoever knows it can read the result.
        folder: with the upload and the results.
        photo: name that the client gave the file, or "".
        settings: of ``[photo]``.
        state: "queued", "running", "done" or "failed".
        error: why it failed, or "".
        stages: name, number from 0 and count of each stage that has begun.
        summary: numbers of the result.
        files: names of the files that can be downloaded.
        retried: whether it was given to a second worker, since the first one ended before it began.
        changed: when it was finished, or put into the queue, s of ``time.monotonic``.
    """

    id: str
    folder: Path
    photo: str = ""
    settings: dict[str, float] = field(default_factory=dict)
    state: str = "queued"
    error: str = ""
    stages: list[tuple[str, int, int]] = field(default_factory=list)
    summary: dict[str, Any] = field(default_factory=dict)
    files: dict[str, Path] = field(default_factory=dict)
    retried: bool = False
    changed: float = field(default_factory=time.monotonic)

    @property
    def finished(self) -> bool:
        """Whether nothing more will happen."""
        return self.state in {"done", "failed"}


class Jobs:
    """Runs one photo at a time in a worker process; methods may be called from any thread.

    Args:
        folder: for uploads and results, one folder each.
        open_worker: starts a worker process.
        limits: of queue, time and results.
    """

    def __init__(self, folder: Path, open_worker: Callable[[], Worker], limits: Limits) -> None:
        self.limits = limits
        self.refused = self._why_refused = ""  # for clients, and for the log
        self._opened = threading.Event()
        self.folder, self._open_worker = folder, open_worker
        self._jobs: dict[str, Job] = {}
        self._waiting: deque[Job] = deque()
        self._running: Job | None = None
        self._change = threading.Condition()
        self._seconds: deque[float] = deque(maxlen=8)
        self._worker: Worker | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._serve, name="jobs", daemon=True)

    def start(self) -> None:
        """Start the worker process and the thread that feeds it."""
        self._thread.start()

    def wait_until_open(self) -> str:
        """Wait until the worker has loaded the backends; return why it cannot, for the log, or ""."""
        while not self._opened.wait(0.1) and self._thread.is_alive():
            pass
        return self._why_refused if self.refused else ""

    def close(self) -> None:
        """End the worker and delete all uploads and results."""
        with self._change:
            self._closed = True
            self._change.notify_all()
            if self._worker is not None:
                self._worker.end()
        self._thread.join(10.0)
        shutil.rmtree(self.folder, ignore_errors=True)

    @contextmanager
    def new(self) -> Iterator[Job]:
        """Yield a job with an empty folder for the photo, and put it into the queue at the end of the block.

        Uploads take no place in the queue, so that slow ones leave room. After an exception, the folder is deleted.

        Raises:
            QueueFull: too many photos wait, before the block or after it.
            OSError: the folder cannot be made.
        """
        self._require_room()
        name = secrets.token_urlsafe(16)
        job = Job(name, self.folder / name)
        try:
            job.folder.mkdir()
            yield job
            with self._change:
                self._require_room()
                job.changed = time.monotonic()
                self._jobs[name] = job
                self._waiting.append(job)
                self._change.notify_all()
        except BaseException:
            shutil.rmtree(job.folder, ignore_errors=True)
            raise

    def _require_room(self) -> None:
        with self._change:
            if len(self._waiting) + (self._running is not None) > self.limits.queue:
                each = sum(self._seconds) / len(self._seconds) if self._seconds else 30.0
                raise QueueFull(max(1, round(each)))

    def get(self, name: str) -> Job | None:
        """Return a job, or None if there is none of this name or it was deleted."""
        return self._jobs.get(name)

    def position(self, job: Job) -> int:
        """Return how many photos are before this one, with the one that runs; 0 for one that does not wait."""
        with self._change:
            return self._waiting.index(job) + (self._running is not None) if job in self._waiting else 0

    def counts(self) -> dict[str, int]:
        """Return how many photos wait, run and are kept as results."""
        with self._change:
            finished = sum(job.finished for job in self._jobs.values())
            return {"waiting": len(self._waiting), "running": int(self._running is not None), "kept": finished}

    def delete(self, job: Job) -> None:
        """Delete the upload and the result of a job, whatever its state; a running one is ended."""
        with self._change:
            self._jobs.pop(job.id, None)
            with suppress(ValueError):
                self._waiting.remove(job)
            if not job.finished:
                job.state, job.error = "failed", "it was deleted"
            shutil.rmtree(job.folder, ignore_errors=True)

    def delete_old(self) -> None:
        """Delete finished jobs that are too old, and the oldest if there are too many."""
        now = time.monotonic()
        with self._change:
            finished = sorted((j for j in self._jobs.values() if j.finished), key=lambda j: j.changed)
            surplus = len(finished) - self.limits.results
            for number, job in enumerate(finished):
                if number < surplus or now - job.changed > self.limits.result_s:
                    self.delete(job)

    def _serve(self) -> None:
        while not self._closed:
            with self._change:
                if self._closed:
                    return
                self._worker = worker = self._open_worker()
            try:
                self._feed(worker)
            except Exception:
                _LOG.exception("the queue goes on with a new worker")
                if self._running is not None:
                    self._finish(self._running, Message("failed", "an unexpected error; the server's log has more"))
            worker.end()

    def _feed(self, worker: Worker) -> None:
        """Give jobs to one worker until it dies or has to be ended."""
        messages = worker.receive()
        for message in messages:
            if message is None:
                continue
            if message.kind == "ready":
                self.refused = ""
                self._opened.set()
                break
            self.refused = "the models cannot be loaded; the server's log has more"
            self._why_refused = f"the models cannot be loaded: {message.content}"
            _LOG.error(self._why_refused)
            self._opened.set()
            self._fail_waiting()
            with self._change:
                self._change.wait(0 if self._closed else _PAUSE_S)
            return
        while (job := self._next(worker)) is not None:
            worker.send(Task(job.folder, job.photo, job.settings))
            start = time.monotonic()
            usable = self._follow(job, messages, start + self.limits.job_s)
            self._seconds.append(time.monotonic() - start)
            self.delete_old()
            if not usable:
                return

    def _next(self, worker: Worker) -> Job | None:
        """Wait for a job; None if the server is closed, or the worker has ended."""
        with self._change:
            while not self._closed:
                if not worker.alive:
                    _LOG.warning("the worker process ended while it had no photo; a new one is started")
                    return None
                if self._waiting:
                    self._running = job = self._waiting.popleft()
                    job.state, job.changed = "running", time.monotonic()
                    return job
                self._change.wait(_EVERY_S)
                self.delete_old()
        return None

    def _follow(self, job: Job, messages: Any, deadline: float) -> bool:
        """Follow a job until it ends; return whether the worker can be used for another one."""
        for message in messages:
            if message is not None and message.kind == "stage":
                job.stages.append(message.content)
            elif message is not None and message.kind == "died" and not (job.stages or job.retried or job.finished):
                with self._change:  # the worker ended just before it got the photo
                    self._running, job.state, job.retried = None, "queued", True
                    self._waiting.appendleft(job)
                return False
            elif message is not None:
                self._finish(job, message)
                return bool(message.kind != "died")
            elif time.monotonic() > deadline:
                self._finish(job, Message("failed", f"no result after {self.limits.job_s:g} s, the limit"))
                return False
            elif job.finished:  # deleted
                self._finish(job, Message("failed", job.error))
                return False
        return False

    def _finish(self, job: Job, message: Message) -> None:
        with self._change:
            self._running = None
            job.changed = time.monotonic()
            (job.folder / PHOTO_FILE).unlink(missing_ok=True)
            if job.id not in self._jobs:
                shutil.rmtree(job.folder, ignore_errors=True)
            elif message.kind == "done":
                job.summary = message.content
                job.files = {file.name: file for file in sorted(job.folder.iterdir())}
                job.state = "done"
            else:
                job.error, job.state = str(message.content), "failed"
                shutil.rmtree(job.folder, ignore_errors=True)

    def _fail_waiting(self) -> None:
        with self._change:
            while self._waiting:
                job = self._waiting.popleft()
                job.error, job.changed, job.state = self.refused, time.monotonic(), "failed"
