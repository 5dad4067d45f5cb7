from __future__ import annotations

import importlib
import pkgutil
import re
from pathlib import Path

import pytest

import physic_core
from physic_core import errors

PUBLIC = [
    "BackendError",
    "BackendNotFoundError",
    "BackendOutputError",
    "BackendRecord",
    "BodyModelError",
    "CommandRecord",
    "Config",
    "ConfigError",
    "DeviceError",
    "EnergyRecord",
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
    "engine_preset",
    "engine_preset_names",
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


def test_the_public_names_are_these():
    assert physic_core.__all__ == PUBLIC


@pytest.mark.parametrize("room", ["adapters", "metrics"])
def test_the_page_of_a_room_names_all_that_is_promised(room: str, repository: Path):
    """Each module of the room in one row with its ``__all__``, but for what the page calls private."""
    page = (repository / "docs" / f"{room}.md").read_text()
    rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]*) \|", page, re.M))
    named = {module: set(re.findall(r"`(\w+)`", names)) for module, names in rows.items()}
    modules = {found.name for found in pkgutil.iter_modules([str(repository / "physic_core" / room)])}
    assert modules - named.keys() == ({"shapes"} if room == "metrics" else set())
    for module, names in named.items():
        assert set(importlib.import_module(f"physic_core.{room}.{module}").__all__) == names, module


@pytest.mark.parametrize("name", PUBLIC)
def test_a_public_name_is_there(name: str):
    assert getattr(physic_core, name) is not None
    assert name in dir(physic_core)


def test_every_error_is_a_physic_error():
    assert all(issubclass(getattr(errors, name), errors.PhysicError) for name in errors.__all__)
