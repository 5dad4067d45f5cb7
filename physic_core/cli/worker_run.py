"""Reconstruct the photo of ``physic run`` in another process, which is ended if a backend exceeds its time limit."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_core.batch.workers import SupervisedWorker, WorkerSettings, error_named
from physic_core.errors import BackendError, PhysicError

if TYPE_CHECKING:
    from physic_core.types import Reconstruction


@dataclass(frozen=True)
class RunArguments:
    """What the configuration of a run is made of.

    Attributes:
        file: of the configuration; None for none.
        settings: preset, overrides and flags, as of :func:`physic_core.configuration.resolve.load_checked_config`.
        timeout_s: of ``[run]``, s.
        quiet: whether to show no progress.
    """

    file: Path | None
    settings: Mapping[str, Any]
    timeout_s: float
    quiet: bool = False


def reconstruct_in_worker(photo: Path, arguments: RunArguments) -> tuple[Reconstruction, list[tuple[str, str]]]:
    """Reconstruct a photo, and return the result and the messages of plugins.

    Raises:
        ConfigError: the configuration is invalid.
        PhysicError: as :func:`physic_core.pipeline.run.reconstruct_photo`.
        BackendError: a call of a backend exceeded its limit, or ended the process; the message names it.
    """
    worker: SupervisedWorker[Path] = SupervisedWorker(
        partial(_open_worker, arguments), WorkerSettings(single_thread=False, attempts=1)
    )
    try:
        outcome = worker(photo)
    finally:
        worker.close()
    if outcome.failure:
        raise BackendError(f"{photo}: {outcome.message}")
    error, value = outcome.value
    if error:
        raise error_named(error, value)
    result, messages = value
    return result, messages


def _open_worker(arguments: RunArguments) -> Callable[[Path], Any]:
    return partial(_run, arguments)


def _run(arguments: RunArguments, photo: Path) -> tuple[str, Any]:
    """Return ("", (result, messages)), or the class and the message of an error."""
    from physic_core.cli.output import printed_logs
    from physic_core.cli.run_messages import collect_plugin_messages, show_progress
    from physic_core.configuration.resolve import load_plan
    from physic_core.discovery.error_text import traceback_text
    from physic_core.discovery.plugin_code import own_stdout
    from physic_core.discovery.plugins import discover
    from physic_core.pipeline.run import reconstruct_photo
    from physic_core.pipeline.time_limit import CONSTRUCTION, limited_calls, timed_call

    try:
        with own_stdout(), limited_calls(arguments.timeout_s), timed_call(CONSTRUCTION):
            plan = load_plan(discover(), arguments.file, **arguments.settings)
        with (
            own_stdout(),
            printed_logs(),
            collect_plugin_messages() as messages,
            show_progress(arguments.quiet) as progress,
        ):
            result = reconstruct_photo(photo, plan, progress=progress)
    except PhysicError as error:
        sys.stderr.write(traceback_text(error))
        return type(error).__name__, str(error)
    return "", (result, messages)
