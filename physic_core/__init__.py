"""Reconstruct people, scene and contact from one photo, in one camera frame (OpenCV axes, metres).

All names but the errors are imported at their first use, so that commands that only list or print
start fast.
"""

from __future__ import annotations

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
    from physic_core.io.photo import Photo, read_photo
    from physic_core.io.report_file import save_report
    from physic_core.io.results import load_people, load_reconstruction, save_reconstruction
    from physic_core.pictures import preview_png, report_html
    from physic_core.pipeline.run import Pipeline, reconstruct
    from physic_core.pipeline.stage_runner import load_backend
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
    "read_photo",
    "reconstruct",
    "report_html",
    "save_reconstruction",
    "save_report",
]

_NAMES = {
    "physic_core.configuration.model": "Config engine_preset engine_preset_names load_config",
    "physic_core.discovery.backends": "find_backend list_backends",
    "physic_core.discovery.plugins": "find_exporter find_exporters",
    "physic_core.discovery.hooks": "ExporterRecord PluginItem hookimpl",
    "physic_core.export": "ExportRequest export_reconstruction",
    "physic_core.io.photo": "Photo read_photo",
    "physic_core.io.report_file": "save_report",
    "physic_core.io.results": "load_people load_reconstruction save_reconstruction",
    "physic_core.pictures": "preview_png report_html",
    "physic_core.pipeline.stage_runner": "load_backend",
    "physic_core.pipeline.run": "Pipeline reconstruct",
    "physic_core.types": "Intrinsics KnownLength KnownSizes PeoplePrompt Person Reconstruction "
    "Scene",
    "physic_core.types.records": "ExportedFiles",
}
_ON_FIRST_USE = {name: module for module, names in _NAMES.items() for name in names.split()}
"""Module of each name that is imported at its first use."""


_DOORS = {
    "export": "physic_core.export:export_reconstruction",
    "joint_angles": "physic_core.body.joint_angles:joint_angles",
    "joints_beside": "physic_core.body.joint_angles:joints_beside",
    "load": "physic_core.io.results:load_reconstruction",
    "preview": "physic_core.pictures:preview_png",
    "report": "physic_core.io.report_file:save_report",
    "save": "physic_core.io.results:save_reconstruction",
}


def _imported(target: str) -> Any:
    module, _, name = target.partition(":")
    return getattr(import_module(module), name)


DOORS.update({name: partial(_imported, target) for name, target in _DOORS.items()})


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("physic_core.discovery.entry_points").core_version()
    if name not in _ON_FIRST_USE:
        raise AttributeError(f"module 'physic_core' has no attribute '{name}'")
    return getattr(import_module(_ON_FIRST_USE[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
