"""The process that holds the pipeline: it reconstructs one photo after the other, and can be killed
at any time.

A photo that crashes it or hangs costs this photo alone: another process is started for the next
one.
"""

from __future__ import annotations

import multiprocessing
import shutil
import signal
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

from physic_batch.workers import processes_started_safely
from physic_core.errors import BackendError, PhysicError
from physic_core.pictures import REPORT_FILE

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from physic_core import Reconstruction

Progress = Callable[[str, int, int], None]
Reconstruct = Callable[["Task", Progress], "Reconstruction"]


class Task(NamedTuple):
    """One photo: the content of its file, its title, settings of ``[photo]``, and the empty folder
    of the result.
    """

    photo: bytes
    title: str
    settings: dict[str, float]
    folder: Path


class Message(NamedTuple):
    """What the process reports.

    "ready", "refused" (reason); "stage" (name, number from 0, count), "done" (summary), "failed"
    (reason).
    """

    kind: str
    content: Any = None


def open_pipeline(config: Any) -> Reconstruct:
    """Load all backends of a configuration, and return the function that reconstructs the photo of
    a task.

    Raises:
        PhysicError: a backend cannot be loaded.
    """
    from physic_core import Pipeline

    pipeline = Pipeline(config)
    pipeline.warm_up()
    return lambda task, progress: pipeline(task.photo, settings=task.settings, progress=progress)


class Worker:
    """The process, seen from the server. It loads the backends while the server goes on.

    Args:
        config: passed to ``open_``.
        exports: formats of ``physic export`` that are written beside each result.
        open_: called in the process; returns the function of a task. Can be pickled.
    """

    def __init__(
        self,
        config: Any,
        exports: tuple[str, ...] = (),
        open_: Callable[[Any], Reconstruct] = open_pipeline,
    ) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_worker_main, args=(theirs, config, exports, open_), daemon=True
        )
        with processes_started_safely():
            self._process.start()
        theirs.close()
        self._is_ready = False

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.is_alive()

    def wait(self) -> None:
        """Wait until the backends are loaded.

        Raises:
            BackendError: they cannot be loaded, or the process was ended; it has ended.
        """
        if not self._is_ready:
            answer = self._receive()
            self._is_ready = answer.kind == "ready"
            if not self._is_ready:
                self.end()
                raise BackendError(f"the models cannot be loaded: {answer.content}")

    def reconstruct(self, task: Task) -> Iterator[Message]:
        """Yield what happens to a photo; the last message is "done" or "failed"."""
        try:
            self.wait()
        except BackendError as error:
            yield Message("failed", str(error))
            return
        with suppress(OSError):  # it has just ended: the next line says so
            self._pipe.send(task)
        while (message := self._receive()).kind == "stage":
            yield message
        yield message

    def end(self) -> None:
        """Kill the process."""
        self._process.kill()
        self._process.join()

    def _receive(self) -> Message:
        try:
            message: Message = self._pipe.recv()
        except (EOFError, OSError):
            self._process.join()
            code = self._process.exitcode
            cause = "; often the memory is too small" if code == -9 else ""
            return Message("failed", f"the process ended with code {code}{cause}")
        return message


def _worker_main(
    pipe: Connection, config: Any, exports: tuple[str, ...], open_: Callable[[Any], Reconstruct]
) -> None:
    # Ctrl-C reaches the server, which ends this process
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(EOFError, OSError):  # the server has ended
        try:
            reconstruct = open_(config)
        except Exception as error:
            pipe.send(Message("refused", _message_of(error)))
            return
        pipe.send(Message("ready"))
        while True:
            pipe.send(
                _run_task(
                    pipe.recv(),
                    reconstruct,
                    exports,
                    lambda *stage: pipe.send(Message("stage", stage)),
                )
            )


def _run_task(
    task: Task, reconstruct: Reconstruct, exports: tuple[str, ...], progress: Progress
) -> Message:
    """Reconstruct the photo of a task and write its files; whatever goes wrong becomes a
    message.
    """
    try:
        result = reconstruct(task, progress)
        progress("write the files", 0, 0)
        result.save(str(task.folder))
    except Exception as error:
        return Message("failed", _message_of(error))
    parts: dict[str, Callable[[], Any]] = {
        "page": partial(result.report, str(task.folder / REPORT_FILE), task.title),
        **{name: partial(_export, result, name, task.folder) for name in exports},
        "summary": result.summary,
    }
    made: dict[str, Any] = {}
    missing = {}
    for name, make in parts.items():
        try:
            made[name] = make()
        except Exception as error:  # the result itself is complete
            missing[name] = str(error)
    return Message("done", {**made.get("summary", {}), "missing_exports": missing})


def _message_of(error: Exception) -> str:
    """Return the message of an error; the class of one that the project does not raise is part."""
    return str(error) if isinstance(error, PhysicError) else f"{type(error).__name__}: {error}"


def _export(result: Reconstruction, name: str, folder: Path) -> None:
    """Write the files of an export into a folder; one with folders is an archive."""
    with TemporaryDirectory(dir=folder) as place:
        result.export(place, name)
        made = [*Path(place).iterdir()]
        if any(path.is_dir() for path in made):
            shutil.make_archive(str(folder / name), "zip", place)
        else:
            for path in made:
                path.replace(folder / path.name)
