"""Worker processes for a batch: each is opened once, gets one task at a time, and is replaced if it dies or hangs.

One process supervises the others and talks to each over a pipe of its own, so that a worker that is killed cannot leave
a lock that the others wait for. Workers end with the supervisor, even if it is killed.
"""

from __future__ import annotations

import faulthandler
import gc
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from multiprocessing import connection
from operator import length_hint
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

from physic_core import errors
from physic_core.batch.machine import peak_memory_mb
from physic_core.errors import BackendError, OutputError, PhysicError
from physic_core.pipeline.time_limit import report_calls_to

__all__ = [
    "LOAD_LIMIT_S",
    "Outcome",
    "SupervisedWorker",
    "WorkerSettings",
    "known_error",
    "report_calls_to",
    "run_in_workers",
]

Task = TypeVar("Task")

LOAD_LIMIT_S = 1800.0
"""Longest time in which a worker must be open."""

_MAX_ATTEMPTS = 2  # a worker that is killed for want of memory need not be the one whose photo needs it
_MAX_FAILED_REPLACEMENTS = 3
_UNKNOWN = 1 << 40  # tasks of an iterator
_END_S = 5.0  # for a process that has closed its pipe
_SINGLE_THREAD = {
    "MKL_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
}


@dataclass(frozen=True)
class Outcome(Generic[Task]):
    """What became of one task.

    Attributes:
        task: as given.
        value: returned by the worker; None if it did not return.
        failure: "" if the worker returned, "Timeout" or "WorkerDied".
        message: reason of the failure.
        seconds: wall-clock time of the last attempt.
        attempts: number of attempts.
        peak_mb: peak memory of the worker so far; 0 if unknown.
    """

    task: Task
    value: Any = None
    failure: Literal["", "Timeout", "WorkerDied"] = ""
    message: str = ""
    seconds: float = 0.0
    attempts: int = 1
    peak_mb: float = 0.0


@dataclass(frozen=True)
class WorkerSettings:
    """How workers are run.

    Attributes:
        count: number of processes; a function gets the peak memory, MB, of the first worker after its first task.
        timeout: longest time of one task, s; None for no limit.
        logs: folder for what the workers print, one file each; None prints to the terminal.
        single_thread: whether libraries use one thread, unless variables of the environment set more.
        attempts: how often a task is tried whose worker dies.
    """

    count: int | Callable[[float], int] = 1
    timeout: float | None = None
    logs: Path | None = None
    single_thread: bool = True
    attempts: int = _MAX_ATTEMPTS


def run_in_workers(
    tasks: Iterable[Task], open_worker: Callable[[], Callable[[Task], Any]], settings: WorkerSettings
) -> Generator[Outcome[Task], None, None]:
    """Run tasks in worker processes and yield their outcomes in the order in which they end.

    The first worker is opened alone, so that one that cannot be opened is reported once. A task whose worker dies is
    tried again once, after all others.

    Args:
        tasks: read as workers become free; can be pickled.
        open_worker: called in each process; returns the function of a task. Can be pickled.
        settings: number of workers, time limit, logs.

    Raises:
        PhysicError: a worker cannot be opened. Its class is that of the error in the worker, if it is one of
            :mod:`physic_core.errors`.
        OutputError: a task raised OutputError.
    """
    yield from _Supervisor(tasks, open_worker, settings).run()


class SupervisedWorker(Generic[Task]):
    """One worker process that stays open between tasks, for executors that hand out tasks themselves.

    A worker that dies or hangs costs its task alone, as in :func:`run_in_workers`, and is replaced.

    Args:
        open_worker: called in the process; returns the function of a task. Can be pickled.
        settings: time limit and logs; ``count`` is not used.

    Raises:
        PhysicError: the worker cannot be opened.
    """

    def __init__(self, open_worker: Callable[[], Callable[[Task], Any]], settings: WorkerSettings) -> None:
        self._supervisor = _Supervisor((), open_worker, replace(settings, count=1))
        self._supervisor.start_and_wait()

    def __call__(self, task: Task) -> Outcome[Task]:
        """Run a task; a second time if its worker dies.

        Raises:
            PhysicError: a new worker cannot be opened.
            OutputError: the task raised OutputError.
        """
        return self._supervisor.run_one(task)

    def close(self) -> None:
        """End the process."""
        self._supervisor.kill()


@dataclass
class _Attempt(Generic[Task]):
    task: Task
    number: int = 1


@dataclass
class _Call:
    """A call of a backend with a time limit."""

    title: str
    seconds: float
    start: float = field(default_factory=time.monotonic)

    @property
    def deadline(self) -> float:
        return self.start + self.seconds


@dataclass
class _Worker(Generic[Task]):
    process: Any
    pipe: connection.Connection
    log: Path | None
    since: float = field(default_factory=time.monotonic)
    ready: bool = False
    attempt: _Attempt[Task] | None = None
    call: _Call | None = None

    def deadline(self, timeout: float | None) -> float | None:
        if not self.ready:
            of_task: float | None = self.since + LOAD_LIMIT_S
        else:
            of_task = None if self.attempt is None or timeout is None else self.since + timeout
        if self.call is None:
            return of_task
        return self.call.deadline if of_task is None else min(of_task, self.call.deadline)

    def exceeded(self) -> str:
        """Return which limit of the configuration a call exceeds; empty for none."""
        if self.call is None or time.monotonic() < self.call.deadline:
            return ""
        return f"{self.call.title}: not finished after {self.call.seconds:g} s; timeout_s of [run] sets the limit"

    def kill(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()


class _Supervisor(Generic[Task]):
    def __init__(
        self, tasks: Iterable[Task], open_worker: Callable[[], Callable[[Task], Any]], settings: WorkerSettings
    ) -> None:
        self._tasks, self._left = iter(tasks), length_hint(tasks, _UNKNOWN)
        self._open, self._settings = open_worker, settings
        self._again: deque[_Attempt[Task]] = deque()
        self._workers: list[_Worker[Task]] = []
        self._context = multiprocessing.get_context("spawn")
        self._next = self._take()
        self._started = self._failed_replacements = 0
        self._limit = 1

    def run(self) -> Iterator[Outcome[Task]]:
        try:
            if self._has_work():
                self._start()
            while self._workers and (self._has_work() or any(w.attempt for w in self._workers)):
                self._fill()
                yield from self._wait()
        finally:
            self.kill()

    def start_and_wait(self) -> None:
        self._start()
        while not self._workers[0].ready:
            for _ in self._wait():
                pass

    def run_one(self, task: Task) -> Outcome[Task]:
        self._again.append(_Attempt(task))
        self._start_if_none_left()
        while True:
            self._fill()
            for outcome in self._wait():
                return outcome

    def kill(self) -> None:
        while self._workers:
            self._workers.pop().kill()

    def _take(self) -> _Attempt[Task] | None:
        for task in self._tasks:
            self._left -= 1
            return _Attempt(task)
        self._left = 0
        return None

    def _has_work(self) -> bool:
        return self._next is not None or bool(self._again)

    def _start(self) -> None:
        ours, theirs = self._context.Pipe()
        log = None if self._settings.logs is None else self._settings.logs / f"worker-{self._started}.txt"
        process = self._context.Process(target=_work, args=(theirs, self._open, log))
        with _environment(_SINGLE_THREAD if self._settings.single_thread else {}):
            process.start()
        theirs.close()
        self._workers.append(_Worker(process, ours, log))
        self._started += 1

    def _fill(self) -> None:
        """Give a task to each idle worker, and start workers up to the limit while there are tasks for them."""
        for worker in list(self._workers):
            if worker.ready and worker.attempt is None and self._has_work():
                attempt = self._next
                if attempt is not None:
                    self._next = self._take()
                else:
                    attempt = self._again.popleft()
                worker.attempt, worker.since = attempt, time.monotonic()
                with suppress(OSError):  # it has just died, which _wait finds
                    worker.pipe.send(attempt.task)
        starting = sum(not worker.ready for worker in self._workers)
        waiting = len(self._again) + (self._next is not None) + self._left
        for _ in range(min(self._limit - len(self._workers), waiting - starting)):
            self._start()

    def _wait(self) -> Iterator[Outcome[Task]]:
        by_handle: dict[Any, _Worker[Task]] = {}
        for worker in self._workers:
            by_handle |= {worker.pipe: worker, worker.process.sentinel: worker}
        limits = [d for worker in self._workers if (d := worker.deadline(self._settings.timeout)) is not None]
        left = max(0.0, min(limits) - time.monotonic()) if limits else None
        found = connection.wait(list(by_handle), left)
        for worker in {id(w): w for w in map(by_handle.__getitem__, found)}.values():
            yield from self._receive(worker)
        for worker in list(self._workers):
            limit = worker.deadline(self._settings.timeout)
            if limit is not None and time.monotonic() >= limit and not worker.pipe.poll():
                yield from self._end_hanging(worker)

    def _receive(self, worker: _Worker[Task]) -> Iterator[Outcome[Task]]:
        try:
            kind, *content = worker.pipe.recv() if worker.pipe.poll() or worker.process.is_alive() else ("died",)
        except (EOFError, OSError):
            kind, content = "died", []
        if kind == "ready":
            worker.ready, self._failed_replacements = True, 0
            if not callable(self._settings.count):
                self._limit = max(1, self._settings.count)
        elif kind == "done":
            value, peak_mb = content
            attempt, worker.attempt = worker.attempt, None
            assert attempt is not None
            if callable(self._settings.count) and self._limit == 1:
                self._limit = max(1, self._settings.count(peak_mb))
            seconds = time.monotonic() - worker.since
            yield Outcome(attempt.task, value, seconds=seconds, attempts=attempt.number, peak_mb=peak_mb)
        elif kind == "call":
            title, limit = content
            worker.call = _Call(title, limit) if title else None
        elif kind == "refused":
            raise known_error(*content)
        else:
            yield from self._replace_dead(worker)

    def _replace_dead(self, worker: _Worker[Task]) -> Iterator[Outcome[Task]]:
        worker.process.join(_END_S)
        how = _describe_end(worker)
        if worker.call is not None:
            how = f"{worker.call.title}: {how}"
        self._remove(worker)
        if not worker.ready:
            self._failed_replacements += 1
            first = self._limit == 1 and self._started == 1
            if first or self._failed_replacements >= _MAX_FAILED_REPLACEMENTS:
                raise BackendError(f"a worker ended while it loaded the backends: {how}")
        attempt = worker.attempt
        if attempt is not None and attempt.number < self._settings.attempts:
            self._again.append(_Attempt(attempt.task, attempt.number + 1))
        elif attempt is not None:
            seconds = time.monotonic() - worker.since
            yield Outcome(attempt.task, None, "WorkerDied", how, seconds, attempt.number)
        self._start_if_none_left()

    def _end_hanging(self, worker: _Worker[Task]) -> Iterator[Outcome[Task]]:
        attempt, seconds, exceeded = worker.attempt, time.monotonic() - worker.since, worker.exceeded()
        self._remove(worker)
        if attempt is None:
            raise BackendError(exceeded or f"the backends are not loaded after {LOAD_LIMIT_S:.0f} s")
        message = exceeded or f"no result after {seconds:.0f} s; --timeout sets the limit"
        yield Outcome(attempt.task, None, "Timeout", message, seconds, attempt.number)
        self._start_if_none_left()

    def _remove(self, worker: _Worker[Task]) -> None:
        worker.kill()
        self._workers.remove(worker)

    def _start_if_none_left(self) -> None:
        if not self._workers and self._has_work():
            self._start()


def _work(pipe: connection.Connection, open_worker: Callable[[], Callable[[Any], Any]], log: Path | None) -> None:
    """Open the worker, then serve tasks until the pipe is closed; runs in the worker process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the supervisor, which ends its workers
    _redirect_output(log)
    faulthandler.enable()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    report_calls_to(lambda title, seconds: pipe.send(("call", title, seconds)))
    try:
        process = open_worker()
    except BaseException as error:
        _print_error()
        pipe.send(("refused", type(error).__name__, str(error)))
        return
    gc.collect()
    gc.freeze()  # the loaded libraries stay: to look through them after each task would take 0.1 s
    pipe.send(("ready",))
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        try:
            answer: tuple[Any, ...] = ("done", process(task), peak_memory_mb())
        except OutputError as error:
            answer = ("refused", "OutputError", str(error))
        pipe.send(answer)
        gc.collect()


def _end_with_parent() -> None:
    """End this process as soon as its parent has ended, whatever it computes."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def _redirect_output(log: Path | None) -> None:
    if log is not None:
        log.parent.mkdir(parents=True, exist_ok=True)
        file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        os.dup2(file, 1)
        os.dup2(file, 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w", buffering=1), os.fdopen(2, "w", buffering=1)


def _print_error() -> None:
    import traceback

    traceback.print_exc()


def known_error(name: str, message: str) -> PhysicError:
    """Return an error of a worker from the name of its class; BackendError if that is not of physic_core.errors."""
    kind = getattr(errors, name, None)
    if isinstance(kind, type) and issubclass(kind, PhysicError):
        return kind(message)
    return BackendError(f"a worker cannot load the backends: {name}: {message}")


def _describe_end(worker: _Worker[Any]) -> str:
    code = worker.process.exitcode
    if code is not None and code < 0:
        with suppress(ValueError):
            text = f"it was ended by {signal.Signals(-code).name}"
            return (
                text
                + ("; often the memory is too small" if -code == getattr(signal, "SIGKILL", 9) else "")
                + _log(worker)
            )
    return f"it exited with code {code}{_log(worker)}"


def _log(worker: _Worker[Any]) -> str:
    return f"; see {worker.log}" if worker.log is not None else ""


class _environment:
    """Set environment variables that are not set, for the processes that are started in the block."""

    def __init__(self, variables: dict[str, str]) -> None:
        self._variables = {name: value for name, value in variables.items() if name not in os.environ}

    def __enter__(self) -> None:
        os.environ.update(self._variables)

    def __exit__(self, *_: object) -> None:
        for name in self._variables:
            os.environ.pop(name, None)
