"""Check what concerns all photos of a batch, before the first one."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_core.batch.process import BatchJob
from physic_core.batch.settings import batch_config
from physic_core.configuration.model import as_config
from physic_core.configuration.resolve import require_available, resolve
from physic_core.discovery.plugins import discover
from physic_core.files.atomic import check_writable
from physic_core.visual.report import require_report

if TYPE_CHECKING:
    from physic_core.batch.saving import Saving
    from physic_core.configuration.model import Config
    from physic_core.discovery.registry import Registry

__all__ = ["prepare_job"]


def prepare_job(
    config: Config | str | os.PathLike[str] | Mapping[str, Any] | None,
    out: str | os.PathLike[str],
    saving: Saving,
    *,
    cache: bool = False,
    registry: Registry | None = None,
    write: bool = True,
) -> BatchJob:
    """Return the job of a batch after checks of its configuration, weights and output folder; no network is loaded.

    Args:
        config: as of :class:`physic_core.Pipeline`.
        out: output folder.
        saving: the files of each photo.
        cache: whether to use the cache of backends' outputs.
        registry: of the backends; the installed ones if None.
        write: whether the output folder is created, and checked to be writable.

    Raises:
        ConfigError: the configuration is invalid.
        WeightsMissingError: weights are missing.
        PackageMissingError: pages are to be written, and no installed plugin makes them.
        OutputError: the folder cannot be written.
    """
    registry = discover() if registry is None else registry
    settings = batch_config(as_config(config), registry, cache=cache)
    require_available(resolve(settings, registry))
    if saving.report:
        require_report()
    return BatchJob(settings, str((check_writable(Path(out)) if write else Path(out)).resolve()), saving)
