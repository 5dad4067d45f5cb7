"""Modules of the user's own, named in a config as "module:Class": one module out of one folder.

Neither the folder of a config nor the current one gets onto Python's path, where any library would find a file called
like something that it tries to import. The module that is named is loaded from its file; of a package (a folder with
``__init__.py``), relative imports reach the rest. A name that Python knows already is refused, not hidden.
"""

from __future__ import annotations

import importlib
import importlib.util
import re
import sys
import threading
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

__all__ = ["TARGET", "in_folder", "load", "split"]

_DOTTED = r"[^\W\d]\w*(?:\.[^\W\d]\w*)*"
TARGET = re.compile(rf"{_DOTTED}:{_DOTTED}")
"""What a target written as text looks like."""

_WITH_FOLDER = re.compile(rf"(?s)(?P<folder>.*)[/\\](?P<target>{TARGET.pattern})")
_lock = threading.RLock()


def in_folder(name: str, folder: Path) -> str:
    """A backend's name with the folder of its module before it, "/folder/module:Class".

    Args:
        name: as written in a config; "sub/module:Class" names a folder itself.
        folder: where the config lies, which relative folders start from.

    Returns:
        The name as it is where it is no "module:Class", or where the folder does not hold the module.
    """
    own, target = split(name)
    if not TARGET.fullmatch(target):
        return name
    place = (folder / own.expanduser() if own else folder).absolute()
    held = own is not None or _file(place, target.partition(":")[0]) is not None
    return f"{place.as_posix().removesuffix('/')}/{target}" if held else name


def split(name: str) -> tuple[Path | None, str]:
    """The folder and the rest of a name as :func:`in_folder` writes it; (None, name) where no folder stands in it."""
    match = _WITH_FOLDER.fullmatch(name)
    return (None, name) if match is None else (Path(match["folder"] or "/"), match["target"])


def load(folder: Path, name: str) -> ModuleType:
    """Import the module ``name`` out of ``folder``, and nothing else that lies there.

    Raises:
        ModuleNotFoundError: it is not there, or imports what is not.
        ImportError: another module of this name is installed, or comes from another folder.
        Exception: whatever it raises itself.
    """
    if _file(folder, name) is None:
        raise ModuleNotFoundError(f"there is no {name.replace('.', '/')}.py in {folder}")
    top = name.partition(".")[0]
    own = _file(folder, top) or folder / top
    with _lock:
        taken = _known(top)
        if taken is not None and own.resolve() not in _places(taken):
            raise ImportError(f"another module is called {top} ({taken.origin or 'a package'}): rename {own}")
        if taken is None:
            _execute(top, own)
        return importlib.import_module(name)


def _file(folder: Path, name: str) -> Path | None:
    path = folder.joinpath(*name.split("."))
    return next((f for f in (path / "__init__.py", path.with_name(f"{path.name}.py")) if f.is_file()), None)


def _known(top: str) -> ModuleSpec | None:
    """What Python finds by this name without us."""
    try:
        return importlib.util.find_spec(top)
    except ValueError:  # imported already, by somebody who did not say from where
        return ModuleSpec(top, None)


def _places(spec: ModuleSpec) -> set[Path]:
    names = [spec.origin] if spec.has_location else spec.submodule_search_locations
    return {Path(name).resolve() for name in names or () if name is not None}


def _execute(top: str, own: Path) -> None:
    """Run a module's file; a folder without ``__init__.py`` becomes a package of what lies in it."""
    if own.suffix == ".py":
        inside = [str(own.parent)] if own.name == "__init__.py" else None
        spec = importlib.util.spec_from_file_location(top, own, submodule_search_locations=inside)
    else:
        spec = ModuleSpec(top, None, is_package=True)
        spec.submodule_search_locations = [str(own)]
    assert spec is not None
    module = sys.modules[top] = importlib.util.module_from_spec(spec)
    try:
        if spec.loader is not None and own.suffix == ".py":
            spec.loader.exec_module(module)
    except BaseException:
        sys.modules.pop(top, None)
        raise
