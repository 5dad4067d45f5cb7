"""Reconstruct people, scene and contact from one photo, in one camera frame (OpenCV axes, metres).

All names but the errors are imported at their first use, so that commands that only list or print start fast.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from physic_core.errors import (
    BackendError,
    BackendNotFoundError,
    BackendOutputError,
    BodyModelError,
    ConfigError,
    DeviceError,
    InputError,
    NoPersonError,
    OutputError,
    PhysicError,
    WeightsMissingError,
)

if TYPE_CHECKING:
    from physic_core.configuration.model import Config, load_config
    from physic_core.discovery.exporters import find_exporter, find_exporters
    from physic_core.discovery.hookspecs import hookimpl
    from physic_core.discovery.plugins import discover
    from physic_core.discovery.records import (
        BackendRecord,
        CommandRecord,
        ExecutorRecord,
        ExporterRecord,
        ReportRecord,
    )
    from physic_core.discovery.registry import Registry
    from physic_core.io.report_file import save_report
    from physic_core.io.results import load_people, load_reconstruction, save_reconstruction
    from physic_core.pipeline.loaded_backends import load_backend
    from physic_core.pipeline.run import Pipeline, reconstruct, reconstruct_photo
    from physic_core.types import (
        Intrinsics,
        KnownLength,
        KnownSizes,
        PeoplePrompt,
        Person,
        Reconstruction,
        Scene,
    )
    from physic_core.types.exports import ExportedFiles
    from physic_core.visual.export.request import ExportRequest
    from physic_core.visual.export.write import export_reconstruction
    from physic_core.visual.preview import preview_png
    from physic_core.visual.report import report_html

__all__ = [
    "BackendError",
    "BackendNotFoundError",
    "BackendOutputError",
    "BackendRecord",
    "BodyModelError",
    "CommandRecord",
    "Config",
    "ConfigError",
    "DeviceError",
    "ExecutorRecord",
    "ExportRequest",
    "ExportedFiles",
    "ExporterRecord",
    "InputError",
    "Intrinsics",
    "KnownLength",
    "KnownSizes",
    "NoPersonError",
    "OutputError",
    "PeoplePrompt",
    "Person",
    "PhysicError",
    "Pipeline",
    "Reconstruction",
    "Registry",
    "ReportRecord",
    "Scene",
    "WeightsMissingError",
    "discover",
    "export_reconstruction",
    "find_exporter",
    "find_exporters",
    "hookimpl",
    "load_backend",
    "load_config",
    "load_people",
    "load_reconstruction",
    "preview_png",
    "reconstruct",
    "reconstruct_photo",
    "report_html",
    "save_reconstruction",
    "save_report",
]

_ON_FIRST_USE = {
    "BackendRecord": "physic_core.discovery.records",
    "CommandRecord": "physic_core.discovery.records",
    "Config": "physic_core.configuration.model",
    "ExecutorRecord": "physic_core.discovery.records",
    "ExportRequest": "physic_core.visual.export.request",
    "ExportedFiles": "physic_core.types.exports",
    "ExporterRecord": "physic_core.discovery.records",
    "Intrinsics": "physic_core.types",
    "PeoplePrompt": "physic_core.types",
    "KnownLength": "physic_core.types",
    "KnownSizes": "physic_core.types",
    "Person": "physic_core.types",
    "Reconstruction": "physic_core.types",
    "Registry": "physic_core.discovery.registry",
    "ReportRecord": "physic_core.discovery.records",
    "Scene": "physic_core.types",
    "discover": "physic_core.discovery.plugins",
    "find_exporter": "physic_core.discovery.exporters",
    "find_exporters": "physic_core.discovery.exporters",
    "hookimpl": "physic_core.discovery.hookspecs",
    "load_backend": "physic_core.pipeline.loaded_backends",
    "load_config": "physic_core.configuration.model",
    "load_people": "physic_core.io.results",
    "load_reconstruction": "physic_core.io.results",
    "export_reconstruction": "physic_core.visual.export.write",
    "preview_png": "physic_core.visual.preview",
    "report_html": "physic_core.visual.report",
    "save_reconstruction": "physic_core.io.results",
    "save_report": "physic_core.io.report_file",
    "Pipeline": "physic_core.pipeline.run",
    "reconstruct": "physic_core.pipeline.run",
    "reconstruct_photo": "physic_core.pipeline.run",
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("physic_core.discovery.plugins").core_version()
    if name not in _ON_FIRST_USE:
        raise AttributeError(f"module 'physic_core' has no attribute '{name}'")
    return getattr(import_module(_ON_FIRST_USE[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
