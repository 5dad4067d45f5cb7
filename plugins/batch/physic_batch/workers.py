"""Worker processes for a batch: each is opened once, gets one task at a time, and is replaced if it
dies or hangs.

Each process has a pipe of its own, so that one that is killed leaves no lock that the others wait
for. Workers end with the process that started them, even if it is killed.
"""

from __future__ import annotations

import faulthandler
import gc
import math
import multiprocessing
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from multiprocessing import connection
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

from physic_core import errors
from physic_core.errors import BackendError, OutputError, PhysicError
from physic_core.files import MARK, check_own, open_to_append, write_own

_IDLE_SHARE = 0.01
"""A worker that uses less than this share of a core for as long as the time limit hangs."""

_LOOK_S = 0.1  # at least this long between two looks at a worker that has nearly used up its time
_RETRY = "--timeout sets the limit, and --retry failed tries the photo again"

_GROUP_FILES = {
    "": ("sys/fs/cgroup", "memory.max", "memory.current", "inactive_file"),
    "memory": (
        "sys/fs/cgroup/memory",
        "memory.limit_in_bytes",
        "memory.usage_in_bytes",
        "total_inactive_file",
    ),
}
"""Folder of control groups of version 2 and 1, the files of a group, and the line of the cache in
``memory.stat``.
"""

_MEMORY_RESERVE = 1.25
"""A worker is expected to need this multiple of what its first photo needed."""

LOAD_LIMIT_S = 1800.0
"""Longest time in which a worker must be open."""


def usable_cores() -> int:
    """Return the number of cores that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def default_workers(peak_mb: float, device: str = "cpu") -> int:
    """Return how many workers fit: one per core, as memory allows; one if they share a GPU.

    Args:
        peak_mb: memory of the first worker after its first photo, MB, without files that all share;
            0 if unknown, then one worker is used.
        device: of the networks.
    """
    if device != "cpu" or peak_mb <= 0:
        return 1
    more = max(0.0, free_memory_mb()) / (_MEMORY_RESERVE * peak_mb)
    return max(1, int(min(usable_cores(), 1 + more)))


def free_memory_mb(root: Path = Path("/")) -> float:
    """Return the memory, MB, that this process may still take; infinity if the system does not say.

    It is the least of the machine's and of all control groups of the process, such as the
    container's, in which the cache of files counts as free.

    Args:
        root: folder with ``proc`` and ``sys``.
    """
    free_mb = [math.inf]
    with suppress(OSError, ValueError, IndexError):
        text = (root / "proc/meminfo").read_text()
        free_mb.append(float(text.partition("MemAvailable:")[2].split()[0]) / 1000)
    with suppress(OSError):
        for line in (root / "proc/self/cgroup").read_text().splitlines():
            # the only line of version 2 has no controllers
            _, controllers, path = line.split(":", 2)
            if controllers in _GROUP_FILES:
                folder, *names = _GROUP_FILES[controllers]
                top = root / folder
                own = top / path.lstrip("/")
                groups = [group for group in (own, *own.parents) if group.is_relative_to(top)]
                free_mb += [_free_memory_of_group(group, *names) for group in groups]
    return min(free_mb)


def _free_memory_of_group(group: Path, limit: str, usage: str, cache: str) -> float:
    """Return the free memory of one control group by the names of its files, MB; infinity without a
    limit.
    """
    with suppress(OSError, ValueError, IndexError):
        cached = (group / "memory.stat").read_text().partition(f"\n{cache} ")[2].split()[0]
        used = int((group / usage).read_text()) - int(cached)
        return (int((group / limit).read_text()) - used) / 1e6
    return math.inf


def _cpu_seconds(pid: int) -> float:
    """Return the CPU seconds of a process and of its children that have ended; elsewhere than on
    Linux, a clock.
    """
    if sys.platform != "linux":
        return time.monotonic()
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def peak_memory_mb() -> float:
    """Return the peak resident memory of this process, MB; 0 if it is unknown."""
    try:
        import resource
    except ImportError:
        return 0.0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e6 if sys.platform == "darwin" else 1e3)


def _own_peak_mb() -> float:
    """Return the peak memory of this process without the pages of files, which other workers share;
    0 if unknown.
    """
    shared = 0.0
    with suppress(OSError, ValueError, IndexError):
        shared = (
            float(Path("/proc/self/status").read_text().partition("RssFile:")[2].split()[0]) / 1e3
        )
    return max(0.0, peak_memory_mb() - shared)


Task = TypeVar("Task")


@dataclass(frozen=True)
class Outcome(Generic[Task]):
    """Result of one task.

    Attributes:
        task: as given.
        value: returned by the worker; None if it did not return.
        failure: "" if the worker returned, "Timeout" or "WorkerDied".
        message: reason of the failure.
        seconds: wall-clock time of the last attempt.
        attempts: number of attempts.
        peak_mb: peak memory of the worker so far, without files that all workers share; 0 if
            unknown.
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
    """Number, time limit and logs of the workers.

    Attributes:
        count: number of processes; a function gets ``Outcome.peak_mb`` of the first worker after
            its first task.
        timeout: CPU seconds after which a task ends, and seconds without work after which it ends;
            None for no limit. Elsewhere than on Linux, seconds by the clock.
        logs: folder for what the workers print, one file each; None prints to the terminal.
    """

    count: int | Callable[[float], int] = 1
    timeout: float | None = None
    logs: Path | None = None


def run_in_workers(
    tasks: Iterable[Task],
    open_worker: Callable[[], Callable[[Task], Any]],
    settings: WorkerSettings,
) -> Generator[Outcome[Task], None, None]:
    """Run tasks in worker processes and yield their outcomes in the order in which they end.

    The first worker is opened alone, so that one that cannot be opened is reported once. A task
    whose worker dies is tried once more, in a new process.

    Args:
        tasks: the next one is read when a worker is free; can be pickled.
        open_worker: called in each process; returns the function of a task. Can be pickled.
        settings: number of workers, time limit, logs.

    Raises:
        PhysicError: a worker cannot be opened. Its class is that of the error in the worker, if it
            is one of :mod:`physic_core.errors`.
        OutputError: a task raised OutputError, or a file of the user has the name of a log.
    """
    if settings.logs is not None:
        check_own(*settings.logs.glob("worker-*.txt"))
    tasks = iter(tasks)
    logs = count()
    limit = 1
    workers: list[_Worker[Task]] = []
    try:
        while True:
            while len(workers) < limit and (task := next(tasks, None)) is not None:
                workers.append(_Worker(open_worker, settings, logs))
                workers[-1].begin(task)
            if not workers:
                return
            for worker in _wait_for_any(workers):
                outcome = worker.step()
                if limit == 1 and worker.is_open and not callable(settings.count):
                    limit = settings.count
                if outcome is None:
                    continue
                if limit == 1 and callable(settings.count) and not outcome.failure:
                    limit = settings.count(outcome.peak_mb)
                yield outcome
                if (task := next(tasks, None)) is None:
                    worker.end()
                    workers.remove(worker)
                else:
                    worker.begin(task)
    finally:
        for worker in workers:
            worker.end()


def _wait_for_any(workers: list[_Worker[Task]]) -> list[_Worker[Task]]:
    """Wait until a worker has sent something, has ended, or has exceeded its time; return all such
    workers.
    """
    left = min(worker.deadline for worker in workers) - time.monotonic()
    handles = [handle for worker in workers for handle in worker.handles]
    ready = connection.wait(handles, None if math.isinf(left) else max(0.0, left))
    now = time.monotonic()
    return [one for one in workers if one.deadline <= now or not set(ready).isdisjoint(one.handles)]


class _TimeLimit:
    """The time limit of one task, in seconds that its worker computes, so that other programs take
    no task its time.

    Attributes:
        deadline: by the monotonic clock, when to look at the worker again.
    """

    def __init__(self, pid: int, limit: float) -> None:
        self._pid = pid
        self._limit = limit
        self._start = self._work_at_mark = _cpu_seconds(pid)
        self._mark = time.monotonic()
        self.deadline = self._mark + limit

    def reason_to_end(self) -> str:
        """Return why the task must end; "" if it may go on, with a later ``deadline``."""
        now = time.monotonic()
        work = _cpu_seconds(self._pid)
        left = self._limit - (work - self._start)
        if left <= 0:
            return f"no result after {self._limit:.0f} s of work"
        if now >= self._mark + self._limit:
            if work - self._work_at_mark < _IDLE_SHARE * (now - self._mark):
                return f"no result, and no work for {now - self._mark:.0f} s"
            self._mark = now
            self._work_at_mark = work
        self.deadline = min(now + max(left, _LOOK_S), self._mark + self._limit)
        return ""


_MAX_ATTEMPTS = 2  # a worker can be killed because the photo of another one needs the memory
_MAX_STARTS = 3
_END_S = 5.0  # for a process that has closed its pipe

_SINGLE_THREAD = {
    "MKL_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
}


class _Worker(Generic[Task]):
    """A process with the task that it has; it is started again after it died or was ended.

    Attributes:
        is_open: whether the process has loaded what it needs.
        deadline: by the monotonic clock, when it must be open, or its task be done.
        handles: become ready when the process has sent something, or has ended.
    """

    def __init__(
        self,
        open_worker: Callable[[], Callable[[Task], Any]],
        settings: WorkerSettings,
        logs: Iterator[int],
    ) -> None:
        self._open_worker = open_worker
        self._settings = settings
        self._logs = logs
        self._process: Any = None
        self._limit: _TimeLimit | None = None
        self._starts = 0
        self.is_open = False

    def begin(self, task: Task) -> None:
        """Give the worker a task."""
        self._task = task
        self._attempt = 1
        self._start_or_send_task()

    def step(self) -> Outcome[Task] | None:
        """Take what the process has sent, or its end; return the outcome of the task if it has one.

        Raises:
            PhysicError: the process cannot be opened.
            OutputError: the task raised OutputError.
        """
        try:
            kind, *content = self._pipe.recv() if self._pipe.poll() else ("silent",)
        except (EOFError, OSError):
            kind = "silent"
            content = []
        seconds = time.monotonic() - self._since
        if kind == "refused":
            raise error_named(*content)
        if kind == "open":
            self.is_open = True
            self._starts = 0
            self._start_or_send_task()
            return None
        if kind == "done":
            return Outcome(self._task, content[0], "", "", seconds, self._attempt, content[1])
        if time.monotonic() >= self.deadline and self._process.is_alive():
            return self._end_if_out_of_time(seconds)
        self._process.join(_END_S)
        how = _end_text(self._process.exitcode, self._log)
        was_open = self.is_open
        self.end()
        if not was_open and self._starts == _MAX_STARTS:
            raise BackendError(f"a worker ended while it loaded the backends: {how}")
        if was_open and self._attempt == _MAX_ATTEMPTS:
            return Outcome(self._task, None, "WorkerDied", how, seconds, self._attempt)
        self._attempt += was_open
        self._start_or_send_task()
        return None

    def _end_if_out_of_time(self, seconds: float) -> Outcome[Task] | None:
        """Return the outcome of a task that has exceeded its time, whose process is ended; None if
        it may go on.

        Raises:
            BackendError: the process is not open.
        """
        if self._limit is None:
            self.end()
            raise BackendError(f"the backends are not loaded after {LOAD_LIMIT_S:.0f} s")
        reason = self._limit.reason_to_end()
        if not reason:
            self.deadline = self._limit.deadline
            return None
        self.end()
        return Outcome(self._task, None, "Timeout", f"{reason}; {_RETRY}", seconds, self._attempt)

    def end(self) -> None:
        """End the process, if there is one."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._pipe.close()
        self._process = None
        self.is_open = False
        self._limit = None

    def _start_or_send_task(self) -> None:
        """Start the process, or send it the task if it is open."""
        self._since = time.monotonic()
        if not self.is_open:
            self._start()
            return
        timeout = self._settings.timeout
        self._limit = None if timeout is None else _TimeLimit(self._process.pid, timeout)
        self.deadline = math.inf if self._limit is None else self._limit.deadline
        with suppress(OSError):  # it has just died, which the next step finds
            self._pipe.send(self._task)

    def _start(self) -> None:
        folder = self._settings.logs
        self._log = None if folder is None else folder / f"worker-{next(self._logs)}.txt"
        if self._log is not None:
            write_own(self._log, f"{MARK}\n".encode())
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        process = context.Process(target=_worker_main, args=(theirs, self._open_worker, self._log))
        with processes_started_safely(_SINGLE_THREAD):
            process.start()
        self._process = process
        theirs.close()
        self._starts += 1
        self.deadline = self._since + LOAD_LIMIT_S
        self.handles = (self._pipe, self._process.sentinel)


def _worker_main(
    pipe: connection.Connection, open_worker: Callable[[], Callable[[Any], Any]], log: Path | None
) -> None:
    """Open the worker, then serve tasks until the pipe is closed; runs in the worker process."""
    # Ctrl-C reaches the parent, which ends its workers
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if log is not None:
        with open_to_append(log) as file:
            os.dup2(file.fileno(), 1)
            os.dup2(file.fileno(), 2)
        sys.stdout = os.fdopen(1, "w", buffering=1)
        sys.stderr = os.fdopen(2, "w", buffering=1)
    faulthandler.enable()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        process = open_worker()
    except BaseException as error:
        traceback.print_exc()
        pipe.send(("refused", type(error).__name__, str(error)))
        return
    gc.collect()
    # garbage collection skips the loaded libraries, which would take 0.1 s after each task
    gc.freeze()
    pipe.send(("open",))
    with suppress(EOFError):
        while True:
            task = pipe.recv()
            try:
                pipe.send(("done", process(task), _own_peak_mb()))
            except OutputError as error:
                pipe.send(("refused", "OutputError", str(error)))
            gc.collect()


def _end_with_parent() -> None:
    """End this process as soon as its parent has ended, even in the middle of a task."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def error_named(name: str, message: str) -> PhysicError:
    """Return an error of a worker from the name of its class; BackendError if that is not of
    physic_core.errors.
    """
    kind = getattr(errors, name, None)
    if isinstance(kind, type) and issubclass(kind, PhysicError):
        return kind(message)
    return BackendError(f"a worker cannot load the backends: {name}: {message}")


def _end_text(code: int | None, log: Path | None) -> str:
    log_text = f"; see {log}" if log is not None else ""
    if code is not None and code < 0:
        with suppress(ValueError):
            memory = (
                "; often the memory is too small" if -code == getattr(signal, "SIGKILL", 9) else ""
            )
            return f"it was ended by {signal.Signals(-code).name}{memory}{log_text}"
    return f"it exited with code {code}{log_text}"


@contextmanager
def processes_started_safely(variables: Mapping[str, str] | None = None) -> Iterator[None]:
    """Start processes in the block: they import nothing from the current folder, where Python looks
    first otherwise.

    Args:
        variables: of the environment of these processes, unless they are set already.
    """
    wanted = {"PYTHONSAFEPATH": "1", **(variables or {})}
    added = wanted.keys() - os.environ.keys()
    os.environ.update({name: wanted[name] for name in added})
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]
