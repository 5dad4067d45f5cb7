"""Reconstruct people, scene and contact from one photo, in one camera frame (OpenCV axes, meters).

All names but the errors are imported at their first use, so that commands that only list or print
start fast.
"""

from __future__ import annotations

import os
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

from physic_core.doors import DOORS
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
from physic_core.lazy import importer

if TYPE_CHECKING:
    from physic_core.configuration.model import (
        Config,
        engine_preset,
        engine_preset_names,
        load_config,
    )
    from physic_core.discovery.backends import find_backend, list_backends
    from physic_core.discovery.hooks import ExporterRecord, PluginItem, hookimpl
    from physic_core.discovery.plugins import find_exporter, find_exporters
    from physic_core.export import ExportRequest, export_reconstruction
    from physic_core.io.body_file import read_bodies, write_bodies
    from physic_core.io.photo import Photo, read_photo
    from physic_core.io.report_file import save_report
    from physic_core.io.results import load_people, load_reconstruction, save_reconstruction
    from physic_core.pictures import preview_png, report_html
    from physic_core.pipeline.run import Pipeline, reconstruct
    from physic_core.pipeline.stage_caller import load_backend
    from physic_core.types import (
        Intrinsics,
        KnownLength,
        KnownSizes,
        PeoplePrompt,
        Person,
        Reconstruction,
        Scene,
    )
    from physic_core.types.records import ExportedFiles

__all__ = [
    "BackendError",
    "BackendNotFoundError",
    "BackendOutputError",
    "BodyModelError",
    "Config",
    "ConfigError",
    "DeviceError",
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
    "Photo",
    "PhysicError",
    "Pipeline",
    "PluginItem",
    "Reconstruction",
    "Scene",
    "WeightsMissingError",
    "engine_preset",
    "engine_preset_names",
    "export_reconstruction",
    "find_backend",
    "find_exporter",
    "find_exporters",
    "hookimpl",
    "list_backends",
    "load_backend",
    "load_config",
    "load_people",
    "load_reconstruction",
    "preview_png",
    "read_bodies",
    "read_photo",
    "reconstruct",
    "report_html",
    "save_reconstruction",
    "save_report",
    "write_bodies",
]

_SILENT = {
    "DO_NOT_TRACK": "1",
    "HF_HUB_DISABLE_TELEMETRY": "1",
    "ORT_DISABLE_TELEMETRY": "1",
    "RAY_USAGE_STATS_ENABLED": "0",
}
"""Variables by which libraries send nothing. They read them when they are imported, so that the
first import of the core, before any plugin, sets them; the user's own values are kept.
"""

for _name, _value in _SILENT.items():
    os.environ.setdefault(_name, _value)

_NAMES = {
    "configuration.model": "Config engine_preset engine_preset_names load_config",
    "discovery.backends": "find_backend list_backends",
    "discovery.plugins": "find_exporter find_exporters",
    "discovery.hooks": "ExporterRecord PluginItem hookimpl",
    "export": "ExportRequest export_reconstruction",
    "io.body_file": "read_bodies write_bodies",
    "io.photo": "Photo read_photo",
    "io.report_file": "save_report",
    "io.results": "load_people load_reconstruction save_reconstruction",
    "pictures": "preview_png report_html",
    "pipeline.stage_caller": "load_backend",
    "pipeline.run": "Pipeline reconstruct",
    "types": "Intrinsics KnownLength KnownSizes PeoplePrompt Person Reconstruction Scene",
    "types.records": "ExportedFiles",
}
"""Module -> its names that are imported at their first use."""

_DOORS = {
    "export": "export_reconstruction",
    "joint_angles": "joint_angles",
    "joints_of_parts": "joints_of_parts",
    "load": "load_reconstruction",
    "person_table": "person_table",
    "photo_row": "photo_row",
    "preview": "preview_png",
    "report": "save_report",
    "save": "save_reconstruction",
    "world": "world_from_camera",
}
_public = importer(__name__, _NAMES)
_BEHIND = {
    "body.joint_angles": "joint_angles joints_of_parts",
    "geometry.world_frame": "world_from_camera",
    "types.tables": "person_table photo_row",
}
_imported = importer(__name__, _NAMES | _BEHIND)

DOORS.update({door: partial(_imported, name) for door, name in _DOORS.items()})


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("physic_core.discovery.entry_points").core_version()
    return _public(name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
