"""The table of the adapters of published estimators: one row each, as they are registered."""

from __future__ import annotations

import importlib
import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "plugins" / "ADAPTERS.md"


@pytest.fixture(scope="module")
def tool(module_at) -> ModuleType:
    return module_at("tools/adapters_table.py")


@pytest.fixture
def records(tool: ModuleType, monkeypatch: pytest.MonkeyPatch) -> list:
    for package, folder in tool.PLUGINS.items():
        monkeypatch.syspath_prepend(str(folder))
        monkeypatch.delitem(sys.modules, package, raising=False)
    return tool.records()


def rows() -> list[list[str]]:
    """interface, backend, how it was checked, the kit."""
    lines = [line for line in TABLE.read_text("utf-8").splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[1:]]


def test_every_backend_has_one_row(records: list) -> None:
    listed = [(interface, name.strip("`")) for interface, name, _, _ in rows()]
    assert sorted(listed) == sorted((r.interface, r.name) for r in records)
    assert all(r.weights_license for r in records)


def test_records_name_the_weights_that_their_defaults_read(
    records: list, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("PHYSIC_WEIGHTS", "XDG_CACHE_HOME", "HF_HOME", "HF_HUB_CACHE"):
        monkeypatch.setenv(name, str(tmp_path / name.lower()))
    monkeypatch.setattr(importlib.import_module("physic_core.weights.find"), "find_in_hub_cache", lambda file: None)
    for record in records:
        module, _, kind = record.target.partition(":")
        lacks = " ".join(getattr(importlib.import_module(module), kind)().missing())
        asked = tuple(re.findall(r"weights '([\w.-]+)' \(", lacks))
        assert record.weights == asked, f"{record.interface} {record.name}"
        assert ("weights" in record.needs) == bool(asked), f"{record.interface} {record.name}"
