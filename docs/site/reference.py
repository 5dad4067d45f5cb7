"""Write the pages of the API reference: one per public module, every public name once."""

from __future__ import annotations

import ast
import inspect
import pkgutil
import sys
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from types import ModuleType

MODULES = {
    "physic_core": "For users",
    "physic_core.types": "Data types",
    "physic_core.interfaces": "Interfaces of backends",
    "physic_core.errors": "Errors",
    "physic_batch.photo_processor": "Many photos",
    "physic_core.weights": "Weights",
    "physic_testing.metrics": "Metrics",
    "physic_core.body": "Body model",
    "physic_core.geometry": "Geometry",
    "physic_core.backends": "Devices, memory, people",
    "physic_core.engine.settings": "Settings of the engine",
    "physic_core.export": "Requests of exports",
    "physic_core.pictures": "The page of a result",
    "physic_visual.scene_mesh": "Meshes of scene and floor",
    "physic_visual.palette": "Colours",
    "physic_visual.rig": "Skeletons and skins",
    "physic_networks": "Helpers for wrappers of networks",
    "physic_testing": "Worlds and conformance",
}
"""The public modules, by the title of their page."""


def reference_pages() -> dict[str, str]:
    """Return the text (reStructuredText) of each page by its file name."""
    documented: dict[int, str] = {}
    written = {}
    for module, title in MODULES.items():
        text = [
            f"{title}\n{'=' * len(title)}",
            f".. module:: {module}",
            *_module_text(module, documented),
        ]
        written[f"{module}.rst"] = "\n\n".join(text) + "\n"
    listed = "\n".join(f"   {module}" for module in MODULES)
    written["index.rst"] = (
        "API reference\n=============\n\n"
        "Generated from the docstrings. :doc:`/docs/api` says which names are stable.\n\n"
        f".. toctree::\n   :maxdepth: 1\n\n{listed}\n"
    )
    return written


def write_reference(folder: Path) -> None:
    """Write the pages into a folder, and leave unchanged files alone, so that a second build is
    fast.
    """
    folder.mkdir(parents=True, exist_ok=True)
    wanted = reference_pages()
    for old in folder.glob("*.rst"):
        if old.name not in wanted:
            old.unlink()
    for name, text in wanted.items():
        if not (folder / name).exists() or (folder / name).read_text(encoding="utf-8") != text:
            (folder / name).write_text(text, encoding="utf-8")


def _module_text(module: str, documented: dict[int, str]) -> list[str]:
    """Return the docstring and the public names of a module, or of the modules of a package that
    exports none.
    """
    imported = import_module(module)
    text = [inspect.getdoc(imported) or ""]
    if names := public_names(imported):
        return text + [
            _entry(f"{module}.{name}", getattr(imported, name), documented) for name in names
        ]
    for inner in sorted(info.name for info in pkgutil.iter_modules(imported.__path__)):
        full = f"{module}.{inner}"
        if public_names(import_module(full)):
            text += [
                f"{inner}\n{'-' * len(inner)}",
                f".. module:: {full}",
                *_module_text(full, documented),
            ]
    return text


def public_names(module: ModuleType) -> list[str]:
    """Return ``__all__`` of a package, else the names without an underscore that the module defines
    at its top.
    """
    if hasattr(module, "__all__"):
        return list(module.__all__)
    names = []
    for statement in ast.parse(inspect.getsource(module)).body:
        if isinstance(statement, (ast.FunctionDef, ast.ClassDef)):
            names.append(statement.name)
        elif isinstance(statement, (ast.Assign, ast.AnnAssign)):
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            names += [target.id for target in targets if isinstance(target, ast.Name)]
    return sorted(name for name in names if not name.startswith("_"))


def _entry(full: str, value: object, documented: dict[int, str]) -> str:
    first = documented.setdefault(id(value), full)
    if first != full:
        return f"``{full.rpartition('.')[2]}`` is :py:obj:`{first}`."
    if inspect.ismodule(value):
        return f".. automodule:: {full}\n   :members:"
    if inspect.isclass(value):
        elsewhere = [
            n
            for n, v in vars(value).items()
            if inspect.isclass(v) and v.__qualname__ != f"{value.__qualname__}.{n}"
        ]
        return f".. autoclass:: {full}\n   :members:\n   :exclude-members: {', '.join(elsewhere)}"
    if callable(value):
        return f".. autofunction:: {full}"
    return (
        f".. py:data:: {full}\n\n   "
        f"{_constant_docstring(full.rpartition('.')[2], full.partition('.')[0])}"
    )


def _constant_docstring(name: str, package: str) -> str:
    """Return the string below the assignment of a constant, in whichever module of the package that
    is.
    """
    for module in [
        m for n, m in sorted(sys.modules.items()) if n.startswith(package) and hasattr(m, name)
    ]:
        body = ast.parse(inspect.getsource(module)).body
        for statement, after in pairwise(body):
            targets = (
                statement.targets
                if isinstance(statement, ast.Assign)
                else [getattr(statement, "target", None)]
            )
            if [getattr(target, "id", None) for target in targets] == [name] and isinstance(
                after, ast.Expr
            ):
                return inspect.cleandoc(str(getattr(after.value, "value", ""))).replace(
                    "\n", "\n   "
                )
    return ""
