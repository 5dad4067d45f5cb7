"""The executor "ray" of ``physic batch``: rows of the journal from actors of a cluster."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable, Generator, Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_batch.photo_processor import BatchJob
from physic_batch.photos import PhotoItem
from physic_batch.run import ExecutorSettings
from physic_batch.workers import LOAD_LIMIT_S, error_named
from physic_core.errors import BackendError, ConfigError
from physic_ray.cluster import connected
from physic_ray.resources import Resources
from physic_ray.worker import JsonActor, WorkerPlan, encode_item, environment_of_driver

if TYPE_CHECKING:
    from physic_batch.run import Executor

MAX_INIT_DEATHS = 2
"""Actors that may die one after the other while they are created.

The backends load in a process of their own, so an actor dies only with its node, or where
metricbody-ray is not installed; the third in a row ends the batch.
"""

_MAX_BLOCKS = 20_000  # tasks of Ray: some milliseconds and kilobytes of the driver each


def ray_executor(settings: ExecutorSettings) -> Executor:
    """Return the executor; see :class:`physic_batch.run.ExecutorSettings`.

    The options are the attributes of :class:`physic_ray.resources.Resources`.

    Raises:
        ConfigError: an option is unknown, or invalid.
    """
    return partial(
        run_on_ray, settings=settings, resources=Resources.from_options(settings.options)
    )


def run_on_ray(
    items: Iterable[PhotoItem],
    job: BatchJob,
    settings: ExecutorSettings,
    resources: Resources | None = None,
    open_worker: Callable[[], Callable[[PhotoItem], dict[str, Any]]] | None = None,
) -> Generator[dict[str, Any], None, None]:
    """Yield a row for each photo, in any order; see :data:`physic_batch.run.Executor`.

    All nodes must see the photos and the output folder under the same paths. A photo whose node is
    lost is done again on another one. ``open_worker`` replaces the pipeline of the job.

    Raises:
        ConfigError: the cluster cannot be reached, or this machine is too small for a worker.
        PhysicError: the backends cannot be loaded, or results cannot be written.
    """
    todo = [encode_item(item) for item in items]
    if not todo:
        return
    resources = (resources or Resources()).for_device(job.config.run.device)
    journal = min(map(str, Path(job.out).glob("journal*.jsonl")), default="")
    environment = environment_of_driver()
    plan = WorkerPlan(
        job, settings.timeout, settings.logs, os.getcwd(), environment, journal, open_worker
    )
    with connected(settings.address) as is_own_cluster:
        yield from _rows(todo, plan, settings, resources, is_own_cluster)


def _rows(
    todo: list[str],
    plan: WorkerPlan,
    settings: ExecutorSettings,
    resources: Resources,
    is_own_cluster: bool,
) -> Generator[dict[str, Any], None, None]:
    import ray
    import ray.data

    slots = resources.count_slots(ray.nodes())
    if is_own_cluster and not slots:
        raise ConfigError(
            f"Ray finds no room for a worker on this machine: it reserves {resources}; "
            "--executor-set cpus=..., gpus=... and memory_gb=... change that"
        )
    limit = min(settings.workers or len(todo), len(todo))
    # With fewer than the default of two tasks in flight, Ray never adds an actor, as for a node
    # that joins later.
    pool = ray.data.ActorPoolStrategy(
        min_size=1, max_size=limit, initial_size=max(1, min(slots, limit))
    )
    blocks = min(len(todo), _MAX_BLOCKS)
    dataset = ray.data.from_items([{"item": text} for text in todo], override_num_blocks=blocks)
    _configure(dataset.context, settings.timeout, -(-len(todo) // blocks))
    rows = dataset.map(
        JsonActor, fn_constructor_args=[plan], compute=pool, **resources.as_ray_arguments()
    )
    try:
        for answer in rows.iter_rows():
            row = json.loads(answer["row"])
            if "refused" in row:
                node = f" (node {row['node']})" if len(ray.nodes()) > 1 else ""
                raise error_named(row["refused"], f"{row['message']}{node}")
            yield row
    except (ray.exceptions.RayError, ray.data.exceptions.SystemException) as error:
        raise BackendError(f"Ray ended the batch: {_last_line(error)}") from error


def _configure(context: Any, timeout: float | None, photos_of_block: int) -> None:
    logging.getLogger("ray.data").setLevel(logging.CRITICAL)
    context.enable_progress_bars = False
    context.print_on_execution_start = False
    context.max_consecutive_actor_init_deaths = MAX_INIT_DEATHS
    # Ray ends a dataset without progress after 30 minutes, which slow photos of one block may need.
    # It still ends one that waits for a node that never comes.
    longest = -1.0 if timeout is None else LOAD_LIMIT_S + 2 * timeout * photos_of_block
    context.execution_no_progress_timeout_s = longest


def _last_line(error: BaseException) -> str:
    """Return the last line of the error that caused others: Ray's messages end with that of the
    remote process.
    """
    while error.__cause__ is not None and str(error.__cause__).strip():
        error = error.__cause__
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1] if lines else type(error).__name__
