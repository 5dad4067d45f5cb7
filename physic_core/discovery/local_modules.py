"""Load a user's own module, named in a config as "module:Class", from one folder.

Neither the config's folder nor the current one is added to ``sys.path``, since a file there could shadow an import of a
library. The named module is loaded from its file. In a package (a folder with ``__init__.py``) relative imports work. A
name that Python can import already is refused, not hidden.
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
"""Pattern of a target "module:Class"."""

_WITH_FOLDER = re.compile(rf"(?s)(?P<folder>.*)[/\\](?P<target>{TARGET.pattern})")
_lock = threading.RLock()


def in_folder(name: str, folder: Path) -> str:
    """A backend's name with the folder of its module before it, "/folder/module:Class".

    Args:
        name: as written in a config; "sub/module:Class" names a folder itself.
        folder: of the config; base of relative folders.

    Returns:
        The unchanged name if it is not "module:Class", or if the folder does not contain the module.
    """
    own, target = split(name)
    if not TARGET.fullmatch(target):
        return name
    place = (folder / own.expanduser() if own else folder).absolute()
    held = own is not None or _file(place, target.partition(":")[0]) is not None
    return f"{place.as_posix().removesuffix('/')}/{target}" if held else name


def split(name: str) -> tuple[Path | None, str]:
    """The folder and the rest of a name as :func:`in_folder` writes it; (None, name) if it contains no folder."""
    match = _WITH_FOLDER.fullmatch(name)
    return (None, name) if match is None else (Path(match["folder"] or "/"), match["target"])


def load(folder: Path, name: str) -> ModuleType:
    """Import the module ``name`` from ``folder``, and no other file of it.

    Raises:
        ModuleNotFoundError: the module, or one that it imports, does not exist.
        ImportError: another module of this name is installed, or comes from another folder.
        Exception: raised by the module.
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
    """Spec that Python finds for this name by itself, or None."""
    try:
        return importlib.util.find_spec(top)
    except ValueError:  # already imported, without a spec
        return ModuleSpec(top, None)


def _places(spec: ModuleSpec) -> set[Path]:
    names = [spec.origin] if spec.has_location else spec.submodule_search_locations
    return {Path(name).resolve() for name in names or () if name is not None}


def _execute(top: str, own: Path) -> None:
    """Run a module's file; a folder without ``__init__.py`` becomes a package of its files."""
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
