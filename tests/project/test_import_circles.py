"""No module imports itself through others, neither in a function nor for types alone."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = [
    ROOT / "physic_core",
    *sorted(path.parent for path in ROOT.glob("[pc]*/physic-*/physic_*/__init__.py")),
]


def imported(file, modules):
    """The modules of the package that a file imports anywhere."""
    found = set[str]()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            found |= {name if name in modules else node.module for name in names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found & modules


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_imports_have_no_circle(package):
    files = {
        ".".join(file.relative_to(package.parent).with_suffix("").parts): file
        for file in package.rglob("*.py")
    }
    files = {name.removesuffix(".__init__"): file for name, file in files.items()}
    left = {name: imported(file, set(files)) - {name} for name, file in files.items()}
    while ends := {name for name in left if not left[name]} | left.keys() - set().union(
        *left.values()
    ):
        left = {name: needed - ends for name, needed in left.items() if name not in ends}
    assert not left, f"these files import each other: {left}"
