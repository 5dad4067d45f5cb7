"""The process that holds the pipeline: it reconstructs one photo after the other, and can be ended at any time.

A photo that crashes it or hangs costs this photo alone: the server ends the process and starts another one.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import re
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing import connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from physic_core import InputError, NoPersonError, OutputError, PhysicError
from physic_core.errors import PackageMissingError

if TYPE_CHECKING:
    from physic_core import Config, Reconstruction

Progress = Callable[[str, int, int], None]
OpenPipeline = Callable[[Any], Callable[["Task", Progress], "Reconstruction"]]

PHOTO_FILE = "photo"
"""Name of an upload on the disk; the name that the client gave is not used for anything."""

REPORT_FILE = "report.html"

_LOG = logging.getLogger("physic_serve")
_POLL_S = 0.2
_PATH = re.compile(r"(?<!\w)[/\\][\w.]|\b[A-Za-z]:[/\\]")  # an absolute one, or below the home folder


class Task(NamedTuple):
    """One photo: the folder with the upload, where the results go too, its name, and settings of ``[photo]``."""

    folder: Path
    photo: str
    settings: dict[str, float]


class Message(NamedTuple):
    """What the process reports: "ready", "stage" (name, number from 0, count), "done" (summary), "failed" (reason)."""

    kind: str
    content: Any = None


def open_pipeline(config: Config) -> Callable[[Task, Progress], Reconstruction]:
    """Load all backends of a configuration, and return the function that reconstructs the photo of a task.

    Raises:
        PhysicError: a backend cannot be loaded.
    """
    from physic_core import Pipeline

    pipeline = Pipeline(config)
    pipeline.warm_up()

    def reconstruct(task: Task, progress: Progress) -> Reconstruction:
        # Bytes, so that no message names a path of this machine.
        return pipeline((task.folder / PHOTO_FILE).read_bytes(), settings=task.settings, progress=progress)

    return reconstruct


class Worker:
    """The process, seen from the server.

    Args:
        config: passed to ``open_``.
        open_: called in the process; returns the function of a task. Can be pickled.
        exports: formats of ``physic export`` that are written beside each result.
    """

    def __init__(self, config: Any, open_: OpenPipeline = open_pipeline, exports: tuple[str, ...] = ()) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs, config, open_, exports), daemon=True)
        self._process.start()
        theirs.close()

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.is_alive()

    def send(self, task: Task) -> None:
        """Give the process a task; if it has just died, :meth:`receive` says so."""
        with suppress(OSError):
            self._pipe.send(task)

    def receive(self) -> Iterator[Message | None]:
        """Yield the messages of the process, and None whenever there is none for a moment; ends with "died"."""
        while True:
            try:
                if self._pipe.poll(_POLL_S):
                    yield self._pipe.recv()
                elif self.alive:
                    yield None
                else:
                    raise EOFError
            except (EOFError, OSError):
                self._process.join(5.0)
                yield Message("died", _describe_end(self._process.exitcode))
                return

    def end(self) -> None:
        """Kill the process."""
        self._process.kill()
        self._process.join()
        self._pipe.close()


def _work(pipe: connection.Connection, config: Any, open_: OpenPipeline, exports: tuple[str, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the server, which ends this process
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        reconstruct = open_(config)
    except Exception as error:
        pipe.send(Message("refused", f"{type(error).__name__}: {error}"))
        return
    pipe.send(Message("ready"))
    while True:
        try:
            task: Task = pipe.recv()
        except EOFError:
            return
        pipe.send(_run(task, reconstruct, exports, lambda *stage: pipe.send(Message("stage", stage))))


def _run(
    task: Task, reconstruct: Callable[[Task, Progress], Reconstruction], exports: tuple[str, ...], progress: Progress
) -> Message:
    """Reconstruct the photo of a task and write its files; whatever goes wrong becomes a message."""
    try:
        result = reconstruct(task, progress)
        progress("write the files", 0, 0)
        result.save(str(task.folder))
        with suppress(PackageMissingError):  # the command says it when it starts
            result.report(str(task.folder / REPORT_FILE), task.photo or "Reconstruction")
    except Exception as error:
        return Message("failed", _reason(error))
    missing = {}
    for name in exports:
        try:
            result.export(str(task.folder), name)
        except Exception as error:  # the result itself is complete
            missing[name] = _reason(error)
    return Message("done", {**result.summary(), **({"missing_exports": missing} if missing else {})})


def _reason(error: Exception) -> str:
    """Return what clients may read of an error: no path of this machine, which the log has."""
    if not isinstance(error, PhysicError):
        _LOG.error("an unexpected error", exc_info=error)
        return f"an unexpected error ({type(error).__name__}); the server's log has more"
    text = str(error) if isinstance(error, (InputError, NoPersonError)) else f"{type(error).__name__}: {error}"
    if not _PATH.search(text):
        return text
    _LOG.error(text)
    if isinstance(error, OutputError) and isinstance(error.__cause__, OSError):
        return f"the server cannot write the result: {error.__cause__.strerror}"
    return f"{type(error).__name__}; the server's log has more"


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def _describe_end(code: int | None) -> str:
    if code is not None and code < 0:
        with suppress(ValueError):
            name = signal.Signals(-code).name
            return f"the process was ended by {name}" + ("; often the memory is too small" if name == "SIGKILL" else "")
    return f"the process ended with code {code}"
