"""Reconstruct one photo of a batch and return its row of the journal; every executor calls this.

An executor opens one :class:`PhotoProcessor` per process or actor, and passes it one photo after
the other. Its rows are ready for JSON; without ``people_rows``, they are flat.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_batch.contact_sheet import write_thumbnail
from physic_batch.journal import COLUMNS, PEOPLE_COLUMN, THUMBNAIL
from physic_batch.photos import PhotoItem, photo_folder
from physic_batch.workers import peak_memory_mb
from physic_core.cache import CodeDigester, files_named_by, made_of
from physic_core.configuration.model import DEFAULT_ENERGY, as_config
from physic_core.configuration.resolve import require_available, resolve
from physic_core.discovery.backends import find_backend, load_class
from physic_core.discovery.entry_points import core_version
from physic_core.discovery.error_text import make_optional_parts
from physic_core.discovery.plugin_code import named_plugin_code
from physic_core.discovery.plugins import find_items
from physic_core.errors import ConfigError, OutputError
from physic_core.files import check_writable, path_to_write
from physic_core.interfaces import INTERFACES
from physic_core.io.result_folder import file_digest, prepare_result_folder, run_of_result
from physic_core.io.results import SAVE, save_reconstruction
from physic_core.types import person_rows

if TYPE_CHECKING:
    from physic_core.configuration.model import Config
    from physic_core.types import Reconstruction

WITHOUT_EFFECT = ("cache", "cache_mb", "low_memory", "threads")
"""Settings of ``[run]`` that change no result by more than rounding, as the option ``threads`` of
backends.
"""

_THUMBNAIL, _SUMMARY, _PEOPLE = "the thumbnail", "the summary", "the table of people"

OTHER_CODE = "code"
"""Word before the digest of the code in the column ``plugins``."""


def batch_config(config: Config, *, with_cache: bool) -> Config:
    """Return a configuration for one of several processes.

    Every backend that has an option ``threads`` gets one thread unless the configuration sets it,
    and ``[run] threads`` is 1 unless it is set. The cache is off unless ``with_cache``: a batch
    sees each photo once.
    """
    run: dict[str, Any] = {"cache": with_cache}
    if config.source("run.threads") == "default":
        run["threads"] = 1
    chosen = {}
    for interface in INTERFACES:
        choice = config.choice(interface)
        if choice.backend == "none":
            continue
        fields = load_class(find_backend(interface, choice.backend)).Options.model_fields
        if "threads" in fields and "threads" not in choice.options:
            chosen[interface] = (choice.backend, {**choice.options, "threads": 1})
    return config.with_backends(chosen).model_copy(
        update={"run": config.run.model_copy(update=run)}
    )


def _config_digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:16]


@dataclass(frozen=True)
class BatchJob:
    """Configuration and outputs of a batch, the same for each photo; it can be pickled.

    Attributes:
        config: of the pipeline; see :func:`physic_batch.photo_processor.batch_config`.
        out: absolute path of the output folder.
        save: which files are written for each photo, one of :data:`physic_core.io.results.SAVE`, or
            "none".
        with_thumbnails: whether to write a thumbnail of each photo for the contact sheet.
    """

    config: Config
    out: str
    save: str
    with_thumbnails: bool = True

    def digest(self, item: PhotoItem) -> str:
        """Return the digest of the settings that the result of a photo depends on.

        Of files that they name, such as weights or a depth map, the content counts.
        """
        of_all, own = self._tables_digest, dict(item.settings)
        return _config_digest([of_all, own, list(files_named_by(own))]) if own else of_all

    @cached_property
    def _tables_digest(self) -> str:
        tables = self.config.as_dict()
        for name in WITHOUT_EFFECT:
            tables["run"].pop(name, None)
        for table in tables.values():
            if isinstance(options := table.get("options"), dict):
                options.pop("threads", None)
        return _config_digest([tables, list(files_named_by(tables))])

    @cached_property
    def version(self) -> str:
        """The version of metricbody, read once."""
        return core_version()

    @cached_property
    def plugins(self) -> str:
        """The plugins of the backends, with versions, and a digest of what :func:`made_of` lists;
        code that has no digest is never the same again.

        Raises:
            PhysicError: a backend cannot be constructed, or its ``fingerprint`` fails.
        """
        code = CodeDigester()
        preset = self.config.engine.preset
        # the hook imports every plugin
        offers = () if preset == DEFAULT_ENERGY else find_items("physic_engine_presets")
        owners = {
            f"{digest.distribution} {digest.version}"
            for digest in offers
            if digest.record.name == preset
        }
        parts = []
        for one in resolve(self.config).backends.values():
            kind = type(one.backend)
            with named_plugin_code(f"{one.title}: fingerprint() fails", kind):
                digest = code.digest(kind) or f"{os.getpid()} {time.time_ns()}"
                parts.append(made_of(one.backend, one.provenance, digest))
            if one.provenance.version:
                owners.add(f"{one.provenance.distribution} {one.provenance.version}")
        return ", ".join([*sorted(owners), f"{OTHER_CODE} {_config_digest(parts)}"])


class PhotoProcessor:
    """A loaded pipeline that turns photos into rows of the journal.

    Args:
        job: of the batch.
        reconstruct: replaces the pipeline of the job's config; called with a path and the settings
            of the photo.

    Raises:
        PhysicError: the backends cannot be loaded.
    """

    def __init__(
        self,
        job: BatchJob,
        reconstruct: Callable[[str, Mapping[str, Any]], Reconstruction] | None = None,
    ) -> None:
        self.job = job
        if reconstruct is None:
            from physic_core import Pipeline

            pipeline = Pipeline(job.config)
            pipeline.warm_up()

            def reconstruct(path: str, settings: Mapping[str, Any]) -> Reconstruction:
                return pipeline(path, settings=settings)

        self._reconstruct = reconstruct
        # Now, as it imports the backends: in a photo, that would count in its time and its limit.
        _ = job.plugins

    def __call__(self, item: PhotoItem) -> dict[str, Any]:
        """Reconstruct a photo, write its files, and return its row; errors of the photo become a
        failed row.

        Raises:
            OutputError: the files cannot be written: the disk is full, or gone.
        """
        # As the photo, files that the settings name may change while they are read.
        start, item, config = time.perf_counter(), item.stamped(), {"config": self.job.digest(item)}
        try:
            if self.job.save != "none":
                photo = file_digest(item.path)
                prepare_result_folder(self._folder(item), photo, overwrite=True)
            result = self._reconstruct(item.path, item.settings)
            parts: dict[str, Callable[[], Any]] = {
                _THUMBNAIL: partial(self._thumbnail, result, item),
                _SUMMARY: result.summary,
                _PEOPLE: partial(person_rows, result),
            }
            made, warnings = make_optional_parts(parts)
            result = result.with_warnings(*warnings) if warnings else result
            files = self._save(result, item)
        except Exception as error:  # an error of one photo must not end the batch
            if isinstance(error, OutputError) and isinstance(error.__cause__, OSError):
                raise  # of the disk, which concerns every photo
            return (
                failed_row(
                    self.job, item, type(error).__name__, str(error), time.perf_counter() - start
                )
                | config
            )
        summary = made.get(_SUMMARY, {})
        loading = float(summary.get("load_seconds") or 0)
        failed = dict.fromkeys(check.name for check in result.checks if check.failed)
        return base_row(self.job, item) | {
            **config,
            "state": "done",
            "seconds": time.perf_counter() - start - loading,
            "photo": result.photo,
            "folder": photo_folder(item.id) if self.job.save != "none" else "",
            "files": " ".join([*files, *made.get(_THUMBNAIL, ())]),
            "checks_failed": " ".join(failed),
            "peak_mb": peak_memory_mb(),
            **{name: value for name, value in summary.items() if name != "seconds"},
            PEOPLE_COLUMN: made.get(_PEOPLE, []),
        }

    def _folder(self, item: PhotoItem) -> Path:
        return path_to_write(Path(self.job.out), photo_folder(item.id))

    def _save(self, result: Reconstruction, item: PhotoItem) -> list[str]:
        """Write the files of a photo, and return their names and sizes as of the column
        ``files``.
        """
        if self.job.save == "none":
            return []
        paths = save_reconstruction(result, self._folder(item), self.job.save, overwrite=True)
        return [f"{path.name}={path.stat().st_size}" for path in paths]

    def _thumbnail(self, result: Reconstruction, item: PhotoItem) -> list[str]:
        """Write the thumbnail of a photo, and return its name and size as of the column
        ``files``.
        """
        if not self.job.with_thumbnails:
            return []
        path = write_thumbnail(result, Path(self.job.out), photo_folder(item.id))
        return [f"{THUMBNAIL}={path.stat().st_size}"]


_MAX_MESSAGE = 5000
"""Characters of a message in the journal."""


def failed_row(
    job: BatchJob, item: PhotoItem, error: str, message: str, seconds: float, attempts: int = 1
) -> dict[str, Any]:
    """Return the row of a photo that has no result.

    Args:
        job: of the batch.
        item: the photo, stamped before it was read; without a stamp the next run tries it again.
        error: name of a class.
        message: of the error.
        seconds: spent on it.
        attempts: how often it was tried.
    """
    return base_row(job, item) | {
        "state": "failed",
        "error": error,
        "message": " ".join(message.split())[:_MAX_MESSAGE],
        "seconds": seconds,
        "attempts": attempts,
        # A file that was replaced meanwhile is not the one that failed.
        "photo": file_digest(item.path) if item.stamped().stamp == item.stamp else "",
    }


def base_row(job: BatchJob, item: PhotoItem) -> dict[str, Any]:
    """Return a row with the columns that do not depend on the result, and empty ones for the
    others.
    """
    return dict.fromkeys(COLUMNS, "") | {
        "id": item.id,
        "path": item.path,
        "seconds": 0.0,
        "attempts": 1,
        "finished": datetime.now(UTC).isoformat(timespec="milliseconds"),
        "stamp": item.stamp,
        "config": job.digest(item),
        "save": job.save,
        "result": run_of_result(Path(job.out, photo_folder(item.id))) if job.save != "none" else "",
        "version": job.version,
        "plugins": job.plugins,
        **dict.fromkeys(("peak_mb", "run")),
    }


def prepare_job(
    config: Config | str | os.PathLike[str] | Mapping[str, Any] | None,
    out: str | os.PathLike[str],
    save: str,
    *,
    with_thumbnails: bool = True,
    with_cache: bool = False,
    create_folder: bool = True,
) -> BatchJob:
    """Return the job of a batch after checks of its configuration, weights and output folder; no
    network is loaded.

    Args:
        config: as of :class:`physic_core.Pipeline`.
        out: output folder.
        save: the files of each photo, one of :data:`physic_core.io.results.SAVE`, or "none".
        with_thumbnails: whether to write a thumbnail of each photo.
        with_cache: whether to use the cache of backends' outputs.
        create_folder: whether the output folder is created, and checked to be writable.

    Raises:
        ConfigError: the configuration or ``save`` is not valid.
        PackageMissingError: no plugin makes the pictures to save.
        WeightsMissingError: weights are missing.
        OutputError: the folder cannot be written, or a link in it leads out.
    """
    if save not in (*SAVE, "none"):
        raise ConfigError(f"what to save is one of {', '.join(SAVE)}, none (got '{save}')")
    if save == "pictures":
        from physic_core.pictures import require_pictures

        require_pictures()
    chosen = as_config(config)
    resolve(chosen)  # lists all errors, each with the place of its value
    settings = batch_config(chosen, with_cache=with_cache)
    require_available(resolve(settings))
    folder = (check_writable(Path(out)) if create_folder else Path(out)).resolve()
    for name in ("photos", "thumbnails"):
        path_to_write(folder, name)
    job = BatchJob(settings, str(folder), save, with_thumbnails)
    _ = job.plugins  # once, for all workers, and before anything is computed
    return job
