from __future__ import annotations

import importlib
import pkgutil
import re
from dataclasses import fields

import pytest

import physic_core
from physic_core import Person, Scene, errors

pytestmark = pytest.mark.quick


def test_the_page_names_all_public_names(repository):
    """In the tables of stable and provisional names; errors are named by their base class."""
    _, _, page = (repository / "docs" / "api.md").read_text().partition("\n## For users\n")
    tables, _, _ = page.partition("\n### ")
    cells = re.findall(r"^\| ([^|]*`[^|]*) \|", tables, re.M)
    named = {name for cell in cells for name in re.findall(r"`(\w+)", cell)}
    subclasses = set(errors.__all__) - {"PhysicError"}
    assert set(physic_core.__all__) - subclasses == named
    assert list(physic_core.__all__) == sorted(physic_core.__all__)


@pytest.mark.parametrize(
    ("page", "rooms"),
    [
        ("networks", ("physic_networks", "physic_core.backends")),
        ("metrics", ("physic_testing.metrics",)),
    ],
)
def test_the_page_of_a_room_names_all_that_is_promised(page, rooms, repository, module_at):
    """Each module of the rooms in one row with its public names, but for what the page calls
    private.
    """
    public_names = module_at("docs/site/reference.py").public_names
    text = (repository / "docs" / f"{page}.md").read_text()
    rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]*) \|", text, re.M))
    named = {module: set(re.findall(r"`(\w+)`", names)) for module, names in rows.items()}
    modules = {
        found.name: f"{room}.{found.name}"
        for room in rooms
        for found in pkgutil.iter_modules(importlib.import_module(room).__path__)
    }
    assert modules.keys() - named.keys() == ({"shapes"} if page == "metrics" else set())
    for module, names in named.items():
        assert set(public_names(importlib.import_module(modules[module]))) == names, module


@pytest.mark.parametrize("name", physic_core.__all__)
def test_a_public_name_can_be_imported_from_the_package(name):
    assert getattr(physic_core, name) is not None
    assert name in dir(physic_core)


def test_every_error_is_a_physic_error():
    assert all(issubclass(getattr(errors, name), errors.PhysicError) for name in errors.__all__)


@pytest.mark.parametrize("record", [Scene, Person], ids=lambda record: record.__name__)
def test_the_page_of_the_api_lists_every_field_of_a_result(repository, record):
    page = (repository / "docs" / "api.md").read_text()
    _, _, section = page.partition(f", a `{record.__name__}`")
    table = section.split("\n\n")[1]
    listed = {
        name for row in table.splitlines() for name in re.findall(r"`(\w+)`", row.split("|")[1])
    }
    assert listed == {field.name for field in fields(record)}
