"""Records of a run: backends, stages with their times, and results of self-checks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["CheckResult", "Provenance", "StageRecord"]


@dataclass(frozen=True)
class Provenance:
    """Backend, plugin and options that produced a result.

    ``plugin`` is the import name of the plugin, ``version`` that of its ``distribution``.
    """

    interface: str
    backend: str
    plugin: str
    distribution: str
    version: str
    options: Mapping[str, Any]
    weights_license: str


@dataclass(frozen=True)
class StageRecord:
    """Name, times and backend of one stage of a run.

    Attributes:
        name: as in the progress bar.
        seconds: without loading weights.
        load_seconds: time to load weights.
        provenance: the backend, or None for a stage of the engine.
        cached: whether the result was read from the cache; the backend was then neither loaded nor called.
        failed: whether the backend failed; an optional backend's failure does not end the run.
    """

    name: str
    seconds: float
    load_seconds: float = 0.0
    provenance: Provenance | None = None
    cached: bool = False
    failed: bool = False


@dataclass(frozen=True)
class CheckResult:
    """Result of one self-check of a reconstruction; :mod:`physic_core.pipeline.checks` lists all checks.

    Attributes:
        name: of the check; stable, so that results can be filtered by it.
        value: the measured number, or None if there was nothing to measure; then ``ok`` is True.
        threshold: the bound on ``value``.
        unit: of both.
        ok: whether the check passed.
        message: meaning of the value; if the check failed, also what to do.
        person: index into ``Reconstruction.people``, or None if the check is about the photo.
    """

    name: str
    value: float | None
    threshold: float
    unit: str
    ok: bool
    message: str
    person: int | None = None
