"""The docstring of a package names its modules that other packages import."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CORE = ROOT / "physic_core"
SOURCES = [CORE, *(path.parent for path in ROOT.glob("[pc]*/physic-*/physic_*/__init__.py"))]
PACKAGES = [
    file.parent
    for file in CORE.rglob("__init__.py")
    if re.search(
        r":mod:`\.\w", ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    )
]


@cache
def importing_packages():
    """The folders whose files import a module of the core, functions included, by the module's
    name.
    """
    found = defaultdict(set)
    for file in (file for source in SOURCES for file in source.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                for name in (node.module, *(f"{node.module}.{alias.name}" for alias in node.names)):
                    found[name].add(file.parent)
    return found


@pytest.mark.parametrize(
    "package", PACKAGES, ids=lambda path: ".".join(path.relative_to(CORE).parts)
)
def test_the_docstring_of_a_package_names_what_three_others_import(package):
    docstring = ast.get_docstring(ast.parse((package / "__init__.py").read_text(encoding="utf-8")))
    named = set(re.findall(r":mod:`\.(\w+)", docstring or ""))
    modules = {
        path.stem
        for path in package.iterdir()
        if path.suffix == ".py" or (path / "__init__.py").is_file()
    }
    assert named <= modules
    prefix = ".".join(package.relative_to(ROOT).parts)
    used = importing_packages()
    asked = {
        name
        for name in modules
        if sum(not path.is_relative_to(package) for path in used[f"{prefix}.{name}"]) >= 3
    }
    assert asked <= named
