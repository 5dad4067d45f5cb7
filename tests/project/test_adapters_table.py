"""The table of the adapters of published estimators: one row each, as they are registered."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

from physic_core.discovery.backends import load_class
from physic_core.weights.library import licence_text, named_sets

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "plugins" / "ADAPTERS.md"


@pytest.fixture(scope="module")
def tool(module_at) -> ModuleType:
    return module_at("tools/adapters_table.py")


def rows() -> list[list[str]]:
    """interface, backend, how it was checked, the kit."""
    lines = [line for line in TABLE.read_text("utf-8").splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[1:]]


def test_every_backend_has_one_row(tool: ModuleType) -> None:
    listed = [(interface, name.strip("`")) for interface, name, _, _ in rows()]
    assert sorted(listed) == sorted((one.interface, one.name) for one in tool.adapters())


def test_every_adapter_reads_weights_by_default_and_their_licence_is_listed(
    tool: ModuleType,
) -> None:
    for one in tool.adapters():
        options = {
            name: field.get_default()
            for name, field in load_class(one).Options.model_fields.items()
        }
        assert licence_text(named_sets(one.distribution, options)), one
