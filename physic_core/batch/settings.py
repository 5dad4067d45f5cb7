"""The configuration of a batch: one thread per process, no cache; and the digest of what results depend on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from physic_core.cache.file_hashes import files_named_by
from physic_core.discovery.backends import find_backend, load_class
from physic_core.interfaces import INTERFACES

if TYPE_CHECKING:
    from physic_core.configuration.model import Config

_WITHOUT_EFFECT = ("cache", "cache_mb", "low_memory", "threads")
"""Settings of ``[run]`` that change no result by more than rounding."""


def batch_config(config: Config, *, cache: bool) -> Config:
    """Return a configuration for one of several processes.

    Every backend that has an option ``threads`` gets one thread unless the configuration sets it, and ``[run] threads``
    is 1 unless it is set. The cache is off unless ``cache``: a batch sees each photo once.
    """
    run: dict[str, Any] = {"cache": cache}
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
    return config.with_backends(chosen).model_copy(update={"run": config.run.model_copy(update=run)})


def config_digest(config: Config) -> str:
    """Return a short digest of the settings of a configuration that results depend on.

    Of files that ``[photo]`` names, such as a depth map, the content counts.
    """
    tables = config.as_dict()
    for name in _WITHOUT_EFFECT:
        tables["run"].pop(name, None)
    for table in tables.values():
        if isinstance(options := table.get("options"), dict):
            options.pop("threads", None)
    return _digest([tables, list(files_named_by(tables["photo"]))])


def settings_digest(of_config: str, settings: Mapping[str, Any]) -> str:
    """Return a short digest of a configuration, given by its digest, with the settings of one photo.

    Of files that the settings name, such as a depth map, the content counts.
    """
    return _digest([of_config, dict(settings), list(files_named_by(settings))]) if settings else of_config


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:16]
