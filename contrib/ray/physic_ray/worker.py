"""The actor: it keeps one worker process open, in which the backends stay loaded, and turns photos
into rows.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

from physic_batch.photo_processor import BatchJob
from physic_batch.photos import PhotoItem
from physic_batch.run import run_locally
from physic_batch.workers import WorkerSettings
from physic_core.errors import OutputError, PhysicError

VISIBLE_S = 30.0


@dataclass(frozen=True)
class WorkerPlan:
    """What an actor needs to know.

    Attributes:
        job: of the batch.
        timeout: of one photo, as of ``physic batch --timeout``; None for no limit.
        logs: folder for what the workers print; None for none.
        folder: current folder of the workers, where it exists.
        environment: variables of the workers.
        shared_file: a file that the driver sees in the output folder; "" for none. A node that does
            not see it would write its results where no one finds them.
        open_worker: replaces the pipeline of the job.
    """

    job: BatchJob
    timeout: float | None = None
    logs: Path | None = None
    folder: str = ""
    environment: Mapping[str, str] = field(default_factory=dict)
    shared_file: str = ""
    open_worker: Callable[[], Callable[[PhotoItem], dict[str, Any]]] | None = None


def environment_of_driver() -> dict[str, str]:
    """Return the variables of this process that PhySIC reads, so that it does the same on every
    node.
    """
    return {name: value for name, value in os.environ.items() if name.startswith("PHYSIC_")}


class PhotoWorker:
    """A loaded pipeline in a process of its own, which is replaced if a photo takes it down or
    hangs.

    Ray alone would repeat such a photo for ever, on one actor after the other.

    Raises:
        OutputError: this node does not see the output folder of the driver.
    """

    def __init__(self, plan: WorkerPlan) -> None:
        if plan.shared_file and not _is_visible(plan.shared_file):
            raise OutputError(
                f"the computer {os.uname().nodename} does not see {plan.shared_file}: "
                "the output folder must be on storage that all nodes mount at this path"
            )
        os.environ.update(plan.environment)
        if plan.folder:
            with suppress(OSError):  # another node need not have it
                os.chdir(plan.folder)
        logs = None if plan.logs is None else plan.logs / f"ray-{os.uname().nodename}-{os.getpid()}"
        self._waiting = deque[PhotoItem]()
        # read one at a time: it is never read while it is empty
        photos = iter(self._waiting.popleft, None)
        self._rows = run_locally(
            photos, plan.job, WorkerSettings(1, plan.timeout, logs), plan.open_worker
        )

    def __call__(self, item: PhotoItem) -> dict[str, Any]:
        """Return the row of a photo.

        Raises:
            OutputError: the files cannot be written.
            PhysicError: the backends cannot be loaded.
        """
        self._waiting.append(item.stamped())
        with _hidden_main_module():
            return next(self._rows)


class JsonActor:
    """Takes and returns JSON text, which is exact for every number and name; for the executor.

    An error that concerns every photo becomes the row {"refused": class, "message": text}, so that
    the driver can raise it as it is: an error in an actor would reach it as the text of a
    traceback.
    """

    def __init__(self, plan: WorkerPlan) -> None:
        self._refused: PhysicError | None = None
        try:
            self._worker = PhotoWorker(plan)
        except PhysicError as error:
            self._refused = error

    def __call__(self, row: Mapping[str, str]) -> dict[str, str]:
        """Return {"row": text} for {"item": text}."""
        answer: dict[str, Any] = {}
        if self._refused is None:
            try:
                answer = self._worker(decode_item(row["item"]))
            except PhysicError as error:
                self._refused = error
        if self._refused is not None:
            answer = {
                "refused": type(self._refused).__name__,
                "message": str(self._refused),
                "node": _node(),
            }
        return {"row": json.dumps(answer)}


def encode_item(item: PhotoItem) -> str:
    """Return a photo as ASCII text; names that are not UTF-8 survive, which Arrow's strings do not
    allow.
    """
    return json.dumps([item.id, item.path, dict(item.settings)])


def decode_item(text: str) -> PhotoItem:
    """Return the photo of :func:`encode_item`."""
    return PhotoItem(*json.loads(text))


def _is_visible(file: str) -> bool:
    """Return whether a file exists; a network file system may show it some seconds late."""
    end = time.monotonic() + VISIBLE_S
    while not os.path.exists(file):
        if time.monotonic() > end:
            return False
        time.sleep(0.2)
    return True


def _node() -> str:
    import ray

    return str(ray.util.get_node_ip_address())


@contextmanager
def _hidden_main_module() -> Iterator[None]:
    """Keep a process that is started here from importing the main script of Ray's worker, with all
    of Ray.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
