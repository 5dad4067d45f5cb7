"""What plugins need of the core is the list of docs/api.md."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from .imports import imported_names

pytestmark = pytest.mark.quick

ROOT = Path(__file__).parents[2]
PLUGINS = [
    path
    for folder in ("plugins", "contrib")
    for path in sorted((ROOT / folder).rglob("*.py"))
    if not {"tests", "build"} & set(path.relative_to(ROOT).parts)
]


def public_modules():
    """The modules of the section for plugin authors."""
    _, _, section = (ROOT / "docs" / "api.md").read_text().partition("\n## For plugin authors\n")
    modules, package = {"physic_core"}, ""
    for name in re.findall(r"`([\w.]+)`", section):
        if not name.startswith("."):
            package = ".".join(name.split(".")[:2])
        modules.add(package + name if name.startswith(".") else name)
    return {name for name in modules if name.partition(".")[0] == "physic_core"}


def imported_modules(path):
    """The modules of the core that a file imports."""
    for module, name in imported_names(path):
        if module.partition(".")[0] == "physic_core":
            inner = f"{module}.{name}"
            yield inner if name and is_module(inner) else module


def is_module(name):
    base = ROOT.joinpath(*name.split("."))
    return base.with_suffix(".py").is_file() or (base / "__init__.py").is_file()


def test_every_public_module_is_there():
    assert [name for name in public_modules() if not is_module(name)] == []


def test_plugins_import_public_modules_of_the_core_alone():
    public = public_modules()
    others = {
        f"{path.relative_to(ROOT)}: {name}"
        for path in PLUGINS
        for name in imported_modules(path)
        if name not in public
    }
    assert sorted(others) == []
