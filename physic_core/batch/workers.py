"""Worker processes for a batch: each is opened once, gets one task at a time, and is replaced if it dies or hangs.

A thread supervises each process and talks to it over a pipe of its own, so that a worker that is killed cannot leave a
lock that the others wait for. Workers end with the process that started them, even if it is killed.
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
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count
from multiprocessing import connection
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

from physic_core import errors
from physic_core.batch.machine import peak_memory_mb
from physic_core.errors import BackendError, OutputError, PhysicError
from physic_core.files.atomic import atomic_write, check_writable
from physic_core.files.own import MARK, check_own, open_to_append

__all__ = [
    "LOAD_LIMIT_S",
    "Outcome",
    "SupervisedWorker",
    "WorkerSettings",
    "error_named",
    "run_in_workers",
]

Task = TypeVar("Task")

LOAD_LIMIT_S = 1800.0
"""Longest time in which a worker must be open."""

_MAX_ATTEMPTS = 2  # a worker can be killed because the photo of another one needs the memory
_MAX_FAILED_REPLACEMENTS = 3
_MAX_WORKERS = 1024
_STARTING = threading.Lock()  # the environment of a process that starts is that of all
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
    """

    count: int | Callable[[float], int] = 1
    timeout: float | None = None
    logs: Path | None = None


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
        OutputError: a task raised OutputError, or a file of the user has the name of a log.
    """
    if settings.logs is not None:
        check_own(*settings.logs.glob("worker-*.txt"))
    left, again = ((task, 1) for task in tasks), deque[tuple[Task, int]]()
    logs, workers, idle = count(), list[_Worker[Task]](), deque[_Worker[Task]]()

    def add_worker() -> _Worker[Task]:
        workers.append(_Worker(open_worker, settings, logs))
        return workers[-1]

    def attempt(task: Task, number: int) -> Outcome[Task]:
        try:
            worker = idle.popleft()
        except IndexError:
            worker = add_worker()
        outcome = worker.try_once(task)
        idle.append(worker)
        return replace(outcome, attempts=number)

    if (following := next(left, None)) is None:
        return
    running: set[Future[Outcome[Task]]] = set()
    with ThreadPoolExecutor(_MAX_WORKERS) as threads:  # one thread waits for each process
        try:
            add_worker().open(tries=1)
            idle.append(workers[0])
            limit = 1 if callable(settings.count) else max(1, settings.count)
            while True:
                while len(running) < limit and (following is not None or again):
                    running.add(threads.submit(attempt, *(following or again.popleft())))
                    following = next(left, None) if following is not None else None
                if not running:
                    return
                done, running = wait(running, return_when=FIRST_COMPLETED)
                for outcome in (future.result() for future in done):
                    if callable(settings.count) and limit == 1 and not outcome.failure:
                        limit = max(1, settings.count(outcome.peak_mb))
                    if outcome.failure == "WorkerDied" and outcome.attempts < _MAX_ATTEMPTS:
                        again.append((outcome.task, outcome.attempts + 1))
                    else:
                        yield outcome
        finally:
            for worker in workers:
                worker.close()


class _ProcessEndedError(Exception):
    """The process of a worker ended; the message says how."""


class _TimeLimitError(Exception):
    """The process of a worker exceeded its time limit and was ended."""


class _Worker(Generic[Task]):
    """One worker process, which is opened when it is needed, and again after it has died or was ended."""

    def __init__(
        self, open_worker: Callable[[], Callable[[Task], Any]], settings: WorkerSettings, logs: Iterator[int]
    ) -> None:
        self._open_worker, self._settings, self._logs = open_worker, settings, logs
        self._process: Any = None
        self._is_closed = False

    def open(self, tries: int = _MAX_FAILED_REPLACEMENTS) -> None:
        """Start the process, and wait until it is ready.

        Raises:
            PhysicError: it cannot be opened.
        """
        try:
            self._start()
            self._receive(time.monotonic() + LOAD_LIMIT_S)
        except _TimeLimitError as error:
            raise BackendError(f"the backends are not loaded after {LOAD_LIMIT_S:.0f} s") from error
        except _ProcessEndedError as error:
            if tries == 1:
                raise BackendError(f"a worker ended while it loaded the backends: {error}") from error
            self.open(tries - 1)

    def try_once(self, task: Task) -> Outcome[Task]:
        """Run a task in the process, which is opened if there is none.

        Raises:
            PhysicError: the process cannot be opened.
            OutputError: the task raised OutputError.
        """
        if self._process is None:
            self.open()
        start, timeout = time.monotonic(), self._settings.timeout
        with suppress(OSError):  # it has just died, which the next line finds
            self._pipe.send(task)
        try:
            value, peak_mb = self._receive(None if timeout is None else start + timeout)
        except _ProcessEndedError as error:
            return Outcome(task, None, "WorkerDied", str(error), time.monotonic() - start)
        except _TimeLimitError:
            seconds = time.monotonic() - start
            message = f"no result after {seconds:.0f} s; --timeout sets the limit"
            return Outcome(task, None, "Timeout", message, seconds)
        return Outcome(task, value, seconds=time.monotonic() - start, peak_mb=peak_mb)

    def close(self) -> None:
        """End the process; none is started any more."""
        with _STARTING:
            self._is_closed = True
            process = self._process
        if process is not None:
            process.kill()
            process.join()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        with _STARTING, _environment(_SINGLE_THREAD):
            if self._is_closed:
                raise BackendError("the workers are closed")
            self._pipe, theirs = context.Pipe()
            folder = self._settings.logs
            self._log = None if folder is None else folder / f"worker-{next(self._logs)}.txt"
            if self._log is not None:
                _start_log(self._log)
            self._process = context.Process(target=_work, args=(theirs, self._open_worker, self._log))
            self._process.start()
            theirs.close()

    def _receive(self, deadline: float | None) -> list[Any]:
        """Wait for an answer of the process, and return its content.

        Raises:
            _ProcessEndedError: it died.
            _TimeLimitError: the deadline passed.
            PhysicError: it cannot be opened, or its task raised OutputError.
        """
        left = None if deadline is None else max(0.0, deadline - time.monotonic())
        if not connection.wait([self._pipe, self._process.sentinel], left):
            self._end()
            raise _TimeLimitError
        try:
            kind, *content = self._pipe.recv() if self._pipe.poll() else ("died",)
        except (EOFError, OSError):
            kind, content = "died", []
        if kind == "refused":
            raise error_named(*content)
        if kind == "died":
            self._process.join(_END_S)
            how = _describe_end(self._process.exitcode, self._log)
            self._end()
            raise _ProcessEndedError(how)
        return content

    def _end(self) -> None:
        process, self._process = self._process, None
        process.kill()
        process.join()
        self._pipe.close()


class SupervisedWorker(_Worker[Task]):
    """One worker process that stays open between tasks, for executors that hand out tasks themselves.

    A worker that dies or hangs costs its task alone, as in :func:`run_in_workers`, and is replaced.

    Args:
        open_worker: called in the process; returns the function of a task. Can be pickled.
        settings: time limit and logs; ``count`` is not used.

    Raises:
        PhysicError: the worker cannot be opened.
    """

    def __init__(self, open_worker: Callable[[], Callable[[Task], Any]], settings: WorkerSettings) -> None:
        super().__init__(open_worker, settings, count())
        self.open(tries=1)

    def __call__(self, task: Task) -> Outcome[Task]:
        """Run a task; a second time if its worker dies.

        Raises:
            PhysicError: a new worker cannot be opened.
            OutputError: the task raised OutputError.
        """
        for number in range(1, _MAX_ATTEMPTS):
            outcome = self.try_once(task)
            if outcome.failure != "WorkerDied":
                return replace(outcome, attempts=number)
        return replace(self.try_once(task), attempts=_MAX_ATTEMPTS)


def _work(pipe: connection.Connection, open_worker: Callable[[], Callable[[Any], Any]], log: Path | None) -> None:
    """Open the worker, then serve tasks until the pipe is closed; runs in the worker process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the supervisor, which ends its workers
    _redirect_output(log)
    faulthandler.enable()
    threading.Thread(target=_end_with_parent, daemon=True).start()
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


def _start_log(log: Path) -> None:
    """Replace the log of an earlier run by a new one.

    Raises:
        OutputError: the file there is of the user, or the folder cannot be written.
    """
    check_own(log)
    with atomic_write(check_writable(log.parent)) as temporary:
        temporary(log.name).write_text(f"{MARK}\n", encoding="utf-8")


def _redirect_output(log: Path | None) -> None:
    if log is not None:
        with open_to_append(log) as file:
            os.dup2(file.fileno(), 1)
            os.dup2(file.fileno(), 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w", buffering=1), os.fdopen(2, "w", buffering=1)


def _print_error() -> None:
    import traceback

    traceback.print_exc()


def error_named(name: str, message: str) -> PhysicError:
    """Return an error of a worker from the name of its class; BackendError if that is not of physic_core.errors."""
    kind = getattr(errors, name, None)
    if isinstance(kind, type) and issubclass(kind, PhysicError):
        return kind(message)
    return BackendError(f"a worker cannot load the backends: {name}: {message}")


def _describe_end(code: int | None, log: Path | None) -> str:
    seen = f"; see {log}" if log is not None else ""
    if code is not None and code < 0:
        with suppress(ValueError):
            memory = "; often the memory is too small" if -code == getattr(signal, "SIGKILL", 9) else ""
            return f"it was ended by {signal.Signals(-code).name}{memory}{seen}"
    return f"it exited with code {code}{seen}"


class _environment:
    """Set environment variables that are not set, for the processes that are started in the block."""

    def __init__(self, variables: dict[str, str]) -> None:
        self._variables = {name: value for name, value in variables.items() if name not in os.environ}

    def __enter__(self) -> None:
        os.environ.update(self._variables)

    def __exit__(self, *_: object) -> None:
        for name in self._variables:
            os.environ.pop(name, None)
