"""Load a user's module, which a config names as "module:Class", from one folder.

The folder is not added to ``sys.path``, because a file in it could replace a library. Only the
named module is loaded. Relative imports work in a package (a folder with ``__init__.py``). The name
of an installed module is refused.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import re
import sys
import threading
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

_DOTTED = r"[^\W\d]\w*(?:\.[^\W\d]\w*)*"
TARGET = re.compile(rf"{_DOTTED}:{_DOTTED}")
"""Pattern of the text "module:Class"."""

_WITH_FOLDER = re.compile(rf"(?s)(?P<folder>.*)[/\\](?P<target>{TARGET.pattern})")
_lock = threading.RLock()


def with_folder(name: str, folder: Path) -> str:
    """Add the folder of the module to a backend name: "module:Class" becomes
    "/folder/module:Class".

    Args:
        name: the name in a config; may contain a relative folder, as in "sub/module:Class".
        folder: folder of the config; base of relative folders.

    Returns:
        The unchanged name if it is not "module:Class", or if the folder does not contain the
        module.
    """
    name_folder, target = split_folder(name)
    if not TARGET.fullmatch(target):
        return name
    folder_path = (folder / os.path.expanduser(name_folder) if name_folder else folder).absolute()
    held = (
        name_folder is not None or _module_file(folder_path, target.partition(":")[0]) is not None
    )
    return f"{folder_path.as_posix().removesuffix('/')}/{target}" if held else name


def split_folder(name: str) -> tuple[Path | None, str]:
    """Split "/folder/module:Class" into folder and "module:Class"; return (None, name) if there is
    no folder.
    """
    match = _WITH_FOLDER.fullmatch(name)
    return (None, name) if match is None else (Path(match["folder"] or "/"), match["target"])


def load_module(folder: Path, name: str) -> ModuleType:
    """Import the module ``name`` from ``folder``; other modules in the folder are not importable.

    Raises:
        ModuleNotFoundError: the module, or one that it imports, does not exist.
        ImportError: another module of this name is installed, or was loaded from another folder.
        Exception: raised by the module.
    """
    if _module_file(folder, name) is None:
        raise ModuleNotFoundError(f"there is no {name.replace('.', '/')}.py in {folder}")
    top = name.partition(".")[0]
    file = _module_file(folder, top) or folder / top
    with _lock:
        taken = _installed_spec(top)
        if taken is not None and file.resolve() not in _folders_of_spec(taken):
            raise ImportError(
                f"another module is called {top} ({taken.origin or 'a package'}): rename {file}"
            )
        if taken is None:
            _execute(top, file)
        return importlib.import_module(name)


def _module_file(folder: Path, name: str) -> Path | None:
    path = folder.joinpath(*name.split("."))
    # Unlike Path.is_file, os.path.isfile is False also for a name that no file can have.
    return next(
        (f for f in (path / "__init__.py", path.with_name(f"{path.name}.py")) if os.path.isfile(f)),
        None,
    )


def _installed_spec(top: str) -> ModuleSpec | None:
    """Return the spec of an installed or already imported module, or None."""
    try:
        return importlib.util.find_spec(top)
    except ValueError:  # already imported, without a spec
        return ModuleSpec(top, None)


def _folders_of_spec(spec: ModuleSpec) -> set[Path]:
    names = [spec.origin] if spec.has_location else spec.submodule_search_locations
    return {Path(name).resolve() for name in names or () if name is not None}


def _execute(top: str, file: Path) -> None:
    """Execute the file of a module; a folder without ``__init__.py`` becomes a package."""
    if file.suffix == ".py":
        inside = [str(file.parent)] if file.name == "__init__.py" else None
        spec = importlib.util.spec_from_file_location(top, file, submodule_search_locations=inside)
    else:
        spec = ModuleSpec(top, None, is_package=True)
        spec.submodule_search_locations = [str(file)]
    assert spec is not None
    module = sys.modules[top] = importlib.util.module_from_spec(spec)
    try:
        if spec.loader is not None and file.suffix == ".py":
            spec.loader.exec_module(module)
    except BaseException:
        sys.modules.pop(top, None)
        raise
