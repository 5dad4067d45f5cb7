"""PhySIC as a step of a Ray Data pipeline: rows with paths in, one flat row for each photo out."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from physic_batch.journal import COLUMNS, NUMBERS, all_columns
from physic_batch.photo_processor import prepare_job
from physic_batch.photos import PhotoItem, photo_of_row
from physic_core.errors import ConfigError
from physic_ray.executor import MAX_INIT_DEATHS
from physic_ray.resources import Resources
from physic_ray.worker import PhotoWorker, WorkerPlan, environment_of_driver

if TYPE_CHECKING:
    import ray.data

    from physic_core import Config

PHOTOS_OF_BLOCK = 16
"""Photos of one task of Ray; what the loss of a node can cost is this much work for each of its
workers.
"""

_INTEGERS = ("attempts", "run")
_CPUS_OF_RAY_DATA = 2  # of a task that reads, and of the actor that skips finished rows


def reconstruct(
    dataset: ray.data.Dataset,
    config: Config | str | os.PathLike[str] | Mapping[str, Any] | None = None,
    *,
    save: str = "none",
    out: str | os.PathLike[str] | None = None,
    timeout: float | None = 600.0,
    workers: int | None = None,
    resources: Resources | None = None,
    checkpoint: str | None = None,
) -> ray.data.Dataset:
    """Reconstruct the photos of a dataset, and return a dataset with one row for each; nothing runs
    before it is read.

    The rows have the columns of the journal of ``physic batch``, then all numbers of
    ``Reconstruction.summary``, with the same types in every block. A photo that fails is a row with
    its error.

    Args:
        dataset: rows with a column "path", absolute or a URI, and optionally "bytes" (content of
            the file, as of ``ray.data.read_binary_files``; else the path is opened on the node),
            "camera", "stature" and "id".
        config: as of :class:`physic_core.Pipeline`.
        save: the files to write for each photo, as of ``physic batch --save``.
        out: folder for these files, which all nodes see.
        timeout: of one photo, as of ``physic batch --timeout``; None for no limit.
        workers: most actors; None for as many as the cluster has room for.
        resources: what one actor reserves.
        checkpoint: folder or URI that all nodes see, in which Ray Data keeps the ids of the rows
            that were written. The same program again skips them. It needs a column "id" in the
            files that the dataset is read from, and ``write_parquet`` or another write at the end.

    Raises:
        ConfigError: the configuration or an argument is invalid.
    """
    import ray.data

    job = prepare_job(config, out or tempfile.gettempdir(), save, with_thumbnails=False)
    if out is None and job.save != "none":
        raise ConfigError(f"save='{save}' writes files: give their folder as out=...")
    resources = (resources or Resources()).for_device(job.config.run.device)
    context = dataset.context
    context.max_consecutive_actor_init_deaths = MAX_INIT_DEATHS
    if timeout is None:
        context.execution_no_progress_timeout_s = -1.0
    else:
        least = 2 * timeout * PHOTOS_OF_BLOCK
        context.execution_no_progress_timeout_s = max(
            least, context.execution_no_progress_timeout_s
        )
    if checkpoint is not None:
        _set_checkpoint(dataset, checkpoint, resources)
    pool = ray.data.ActorPoolStrategy(min_size=1, max_size=workers)
    plan = WorkerPlan(job, timeout, None, os.getcwd(), environment_of_driver())
    return dataset.repartition(target_num_rows_per_block=PHOTOS_OF_BLOCK).map_batches(
        TableActor,
        batch_size=None,
        batch_format="pyarrow",
        fn_constructor_args=[plan],
        compute=pool,
        **resources.as_ray_arguments(),
    )


def _set_checkpoint(dataset: ray.data.Dataset, folder: str, resources: Resources) -> None:
    import ray
    from ray.data.checkpoint import CheckpointConfig

    cpus = ray.cluster_resources().get("CPU", 0.0)
    if 0 < cpus < resources.cpus + _CPUS_OF_RAY_DATA:  # 0: the nodes are still to come
        raise ConfigError(
            f"a checkpoint needs {_CPUS_OF_RAY_DATA} CPUs in addition to those of the actors, or "
            f"Ray Data waits forever: the cluster has {cpus:g}, and an actor reserves "
            f"{resources.cpus:g}"
        )
    schema = dataset.schema(fetch_if_missing=False)
    if schema is not None and "id" not in schema.names:
        raise ConfigError(
            f"a checkpoint needs a column 'id' in the dataset (got {', '.join(schema.names)})"
        )
    if "://" not in folder:
        folder = os.path.abspath(folder)
        os.makedirs(folder, exist_ok=True)
    dataset.context.checkpoint_config = CheckpointConfig(
        id_column="id", checkpoint_path=folder, delete_checkpoint_on_success=False
    )


def schema_of_rows() -> pa.Schema:
    """Return the schema of rows: columns of the journal, then the numbers of all results."""

    def kind(name: str) -> pa.DataType:
        if name in _INTEGERS:
            return pa.int64()
        return pa.string() if name in COLUMNS and name not in NUMBERS else pa.float64()

    return pa.schema([(name, kind(name)) for name in all_columns()])


class TableActor:
    """Turns a table of photos into a table of rows with a fixed schema.

    Raises:
        PhysicError: the backends cannot be loaded, or results cannot be written.
    """

    def __init__(self, plan: WorkerPlan) -> None:
        self._worker = PhotoWorker(plan)

    def __call__(self, photos: pa.Table) -> pa.Table:
        """Return the rows of some photos."""
        rows = [self._reconstruct(photo) for photo in photos.to_pylist()]
        schema = schema_of_rows()
        return pa.table(
            {name: [row.get(name) for row in rows] for name in schema.names}, schema=schema
        )

    def _reconstruct(self, photo: Mapping[str, Any]) -> dict[str, Any]:
        item = photo_of_row(photo)
        content = photo.get("bytes")
        if content is None:
            return self._worker(item)
        with tempfile.TemporaryDirectory(prefix="physic-") as folder:
            copy = Path(folder, "photo" + PurePosixPath(item.path).suffix)
            copy.write_bytes(content)
            row = self._worker(PhotoItem(item.id, str(copy), item.settings))
        return row | {
            "path": item.path,
            "message": row["message"].replace(str(copy), item.path),
            "stamp": "",
        }
