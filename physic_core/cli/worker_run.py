"""Reconstruct the photo of ``physic run`` in another process, which is ended if a backend exceeds its time limit."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_core.batch.workers import SupervisedWorker, WorkerSettings, known_error
from physic_core.errors import BackendError, PhysicError

if TYPE_CHECKING:
    from physic_core.configuration.model import Config
    from physic_core.types import Reconstruction

__all__ = ["reconstruct_in_worker"]


def reconstruct_in_worker(photo: Path, config: Config) -> tuple[Reconstruction, list[str]]:
    """Reconstruct a photo, and return the result and the messages of plugins.

    Raises:
        PhysicError: as :func:`physic_core.pipeline.run.reconstruct_photo`.
        BackendError: a call of a backend exceeded its limit, or ended the process; the message names it.
    """
    worker: SupervisedWorker[Path] = SupervisedWorker(
        partial(_open_worker, config), WorkerSettings(single_thread=False, attempts=1)
    )
    try:
        outcome = worker(photo)
    finally:
        worker.close()
    if outcome.failure:
        raise BackendError(f"{photo}: {outcome.message}")
    error, value = outcome.value
    if error:
        raise known_error(error, value)
    result, messages = value
    return result, messages


def _open_worker(config: Config) -> Callable[[Path], Any]:
    return partial(_run, config)


def _run(config: Config, photo: Path) -> tuple[str, Any]:
    """Return ("", (result, messages)), or the class and the message of an error."""
    from physic_core.cli.run import collect_plugin_messages, show_progress
    from physic_core.discovery.error_text import traceback_text
    from physic_core.discovery.plugin_code import own_stdout
    from physic_core.pipeline.run import reconstruct_photo

    try:
        with own_stdout(), collect_plugin_messages() as messages, show_progress() as progress:
            result = reconstruct_photo(photo, config, progress=progress)
    except PhysicError as error:
        sys.stderr.write(traceback_text(error))
        return type(error).__name__, str(error)
    return "", (result, messages)
