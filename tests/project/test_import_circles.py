"""No module imports itself through others, neither in a function nor for types alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from .imports import imported_names

ROOT = Path(__file__).parents[2]
PACKAGES = [
    ROOT / "physic_core",
    *sorted(path.parent for path in ROOT.glob("[pc]*/*/physic_*/__init__.py")),
]


def imported(file, modules):
    """The modules of the package that a file imports anywhere."""
    pairs = list(imported_names(file))
    inner = {f"{module}.{name}" for module, name in pairs} & modules
    outer = {module for module, name in pairs if f"{module}.{name}" not in inner}
    return inner | outer & modules


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
