"""The executors of ``physic batch``: processes on this machine, and those of plugins (hook ``physic_executors``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_core.batch.machine import default_workers
from physic_core.batch.run import run_locally
from physic_core.batch.workers import WorkerSettings
from physic_core.discovery.catalog import EXECUTORS
from physic_core.discovery.plugins import find_item, import_item
from physic_core.errors import ConfigError, PluginError

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable

    from physic_core.batch.photos import PhotoItem
    from physic_core.batch.process import BatchJob
    from physic_core.batch.run import Executor

_LOCAL = "local"


@dataclass(frozen=True)
class ExecutorSettings:
    """How an executor runs the photos of a batch.

    Attributes:
        workers: number of processes or actors; None lets the executor choose.
        timeout: longest time of one photo, s; None for no limit.
        logs: folder for what the workers print; None for none.
        address: of a running cluster; None for none, or for what the executor starts itself.
        options: further settings of the executor, as text.
    """

    workers: int | None = None
    timeout: float | None = None
    logs: Path | None = None
    address: str | None = None
    options: Mapping[str, str] = field(default_factory=dict)


def open_executor(name: str, settings: ExecutorSettings) -> Executor:
    """Return the executor of a name: "local", or one that a plugin offers.

    Raises:
        ConfigError: there is no such executor, or it does not have one of the settings.
        PluginError: it cannot be imported, or returns no function.
    """
    if name == _LOCAL:
        return _local(settings)
    found = find_item("physic_executors", name, "executor", own=_LOCAL, known=EXECUTORS)
    executor: Executor = import_item(found, "executor")(settings)
    if not callable(executor):
        raise PluginError(f"the executor '{name}' should return a function, got {type(executor).__name__}")
    return executor


def _local(settings: ExecutorSettings) -> Executor:
    if settings.address is not None or settings.options:
        option = "--executor-set" if settings.address is None else "--address"
        raise ConfigError(f"{option} is for clusters; the executor 'local' uses this machine (see --executor)")

    def run(items: Iterable[PhotoItem], job: BatchJob) -> Generator[dict[str, Any], None, None]:
        count = settings.workers or partial(default_workers, device=job.config.run.device)
        return run_locally(items, job, WorkerSettings(count, settings.timeout, settings.logs))

    return run
