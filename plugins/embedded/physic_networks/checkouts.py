"""Import code from a repository that the user has checked out, isolated from other modules.

Research repositories often name their packages ``core``, ``models`` or ``utils``, so two of them
cannot be imported together. Here each has its own modules. They are in ``sys.modules`` only while
the code of the checkout runs, and other modules of these names are restored afterwards. Packages of
the environment (torch, timm, ...) are shared.

The code runs with the user's rights. Only folders that the user named are imported.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import os
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import KW_ONLY, dataclass, field
from itertools import chain
from pathlib import Path
from types import ModuleType
from typing import Any

from physic_core.errors import BackendError, WeightsMissingError
from physic_core.interfaces import Packages, Repository, Requirement

NON_COMMERCIAL = frozenset({"smplx"})
"""Python packages with a non-commercial licence, which only the user installs."""

PIP_NAMES: Mapping[str, str] = {
    "PIL": "pillow",
    "cv2": "opencv-python-headless",
    "hydra": "hydra-core",
    "pytorch_lightning": "pytorch-lightning",
    "skimage": "scikit-image",
    "sklearn": "scikit-learn",
    # The commit that MoGe's own pyproject.toml names; the package of that name on the index has
    # another API.
    "utils3d": "git+https://github.com/EasternJournalist/utils3d.git@3fab839f0be9931dac7c8488eb0e1600c236e183",
    "yaml": "pyyaml",
}
"""Name of a module -> name of its pip package, where they differ."""

_CODE = (".py", ".yaml", ".yml", ".json", ".toml")
"""Suffixes of code and configuration."""
_MAX_CODE_BYTES = 1_000_000
"""Larger files are data, such as annotations of a data set."""

_lock = threading.RLock()


@dataclass(eq=False)
class Checkout:
    """A cloned repository whose modules are imported in isolation.

    Attributes:
        folder: its root; "" if its package is installed in the environment, and then nothing is
            isolated.
        name: of the project, for messages.
        package: main module, such as "core.camerahmr_model"; its file must exist.
        homepage: where to get it.
        commit: that the caller was tested with; "" if none was.
        option: the backend's option that names the folder, for messages.
        needs: modules of the environment that its code imports.
    """

    folder: str = ""
    _: KW_ONLY
    name: str
    package: str
    homepage: str
    commit: str = ""
    option: str = "checkout"
    needs: tuple[str, ...] = ()
    _modules: dict[str, ModuleType] = field(default_factory=dict, init=False, repr=False)
    _own: dict[str, Path | None] | None = field(default=None, init=False, repr=False)
    _is_active: bool = field(default=False, init=False, repr=False)
    _fingerprint: str | None = field(default=None, init=False, repr=False)

    @property
    def root(self) -> Path | None:
        """The folder; None if the package is installed in the environment."""
        return Path(os.path.expanduser(self.folder)) if self.folder else None

    def missing(self) -> tuple[str, ...]:
        """Return a message for each missing folder or package, without importing the code."""
        messages = [fault] if (fault := self._problem()) else []
        missing = [
            need for need in self.needs if need not in sys.modules and not _can_be_imported(need)
        ]
        if missing:
            messages.append(
                f"{self.name} needs the package{'s' * (len(missing) > 1)} {', '.join(missing)} of "
                "the environment: pip install "
                f"{' '.join(PIP_NAMES.get(need, need) for need in missing)}"
            )
        return tuple(messages)

    def requirements(self) -> tuple[Requirement, ...]:
        """Return the repository and the packages, for a backend's ``requirements``."""
        root = self.root
        folder, commit = ("", "") if root is None else (str(root), checkout_commit(root))
        here = not self._problem()
        repository = Repository(
            self.option, self.name, self.homepage, self.commit, folder, commit, here
        )
        return (repository, Packages(self.needs)) if self.needs else (repository,)

    def load(self, module: str | None = None) -> ModuleType:
        """Import and return a module of the checkout, by default ``package``.

        Raises:
            WeightsMissingError: the folder is missing or is another project, or a package of the
                environment is missing.
            BackendError: its code cannot be imported.
        """
        fault = self._problem()
        if fault:
            raise WeightsMissingError(fault)
        self._fingerprint = self.fingerprint()
        with self.activated():
            try:
                return importlib.import_module(module or self.package)
            except ModuleNotFoundError as error:
                absent = (error.name or "").partition(".")[0]
                raise WeightsMissingError(
                    f"{self.name}{self._in_folder()} cannot be imported: {error}; if '{absent}' is "
                    f"not a part of it: pip install {PIP_NAMES.get(absent, absent)}"
                ) from error
            except Exception as error:  # its code can raise anything at import
                raise BackendError(
                    f"{self.name}{self._in_folder()} cannot be imported: {type(error).__name__}: "
                    f"{error}; try its own demo in this environment first"
                ) from error

    def attribute(self, name: str, module: str | None = None) -> Any:
        """Return a class or function from a module of the checkout.

        Raises:
            WeightsMissingError: as in :meth:`load`.
            BackendError: its code cannot be imported, or has no such name.
        """
        loaded = self.load(module)
        if not hasattr(loaded, name):
            raise BackendError(
                f"{module or self.package} of {self.name}{self._in_folder()} has no '{name}': "
                f"it may be another version; this backend knows the one of {self.homepage}"
            )
        return getattr(loaded, name)

    @contextmanager
    def activated(self) -> Iterator[None]:
        """Make the modules of the checkout importable inside a ``with`` block, by ``sys.path`` and
        ``sys.modules``.

        Only one checkout is active at a time, in all threads.
        """
        if self.root is None:
            yield
            return
        root = self.root.resolve()
        with _lock:
            if self._is_active:
                yield
                return
            if self._own is None:
                self._own = _top_level_modules(root)  # once: folders of data can be large
            own_modules = self._own
            self._is_active = True
            others = _pop_modules(own_modules)
            sys.modules.update(self._modules)
            for package in own_modules.values():
                if package is not None and package.name not in sys.modules:
                    sys.modules[package.name] = _empty_package(package)
            sys.path.insert(0, str(root))
            importlib.invalidate_caches()
            try:
                yield
            finally:
                if str(root) in sys.path:
                    sys.path.remove(str(root))
                self._modules = _pop_modules(own_modules)
                sys.modules.update(others)
                self._is_active = False

    def close(self) -> None:
        """Discard the imported modules."""
        self._modules = {}
        self._own = None
        self._fingerprint = None

    def fingerprint(self) -> str:
        """Return a hash of the contents of all code and configuration in the folder; "" if the
        folder is missing.

        After :meth:`load` it stays the hash of the imported code, even if its files are edited
        later.
        """
        root = self.root
        if self._fingerprint is not None or root is None or not root.is_dir():
            return self._fingerprint or ""
        return _digest_of_code(root)

    def _problem(self) -> str:
        """Return a message if the folder or the package is missing, else ""."""
        root = self.root
        if root is None:
            if _can_be_imported(self.package.partition(".")[0]):
                return ""
            return (
                f"{self.name} is neither installed nor given: set {self.option} to a checkout of "
                f"{self.homepage} ({self._clone_commands()})"
            )
        if not root.is_dir():
            return (
                f"there is no folder {root}: set {self.option} to a checkout of "
                f"{self.homepage} ({self._clone_commands()})"
            )
        package_path = root.joinpath(*self.package.split("."))
        if package_path.with_suffix(".py").is_file() or package_path.is_dir():
            return ""
        wanted = "/".join(self.package.split(".")) + ".py"
        return (
            f"{root} is not a checkout of {self.name}, since it has no {wanted}: "
            f"set {self.option} to the root of a checkout of {self.homepage}"
        )

    def _clone_commands(self) -> str:
        """Return the commands that clone the repository at the commit that the caller states."""
        clone = f"git clone {self.homepage}"
        folder = self.homepage.rstrip("/").rpartition("/")[2]
        return f"{clone} && git -C {folder} checkout {self.commit}" if self.commit else clone

    def _in_folder(self) -> str:
        """Return " in FOLDER" for messages, or ""."""
        return "" if self.root is None else f" in {self.root}"


def checkout_commit(folder: Path) -> str:
    """Return the commit that a git repository has checked out, without running git; "" if the
    folder is not one.
    """
    git_path = folder / ".git"
    try:
        if git_path.is_file():  # a worktree or a submodule
            git_path = folder / git_path.read_text("utf-8").partition("gitdir: ")[2].strip()
        head = (git_path / "HEAD").read_text("utf-8").strip()
        name = head.partition("ref: ")[2]
        if not name:
            return head
        common = git_path / "commondir"
        root = git_path / common.read_text("utf-8").strip() if common.is_file() else git_path
        if (root / name).is_file():
            return (root / name).read_text("utf-8").strip()
        packed = (root / "packed-refs").read_text("utf-8").splitlines()
        return next((line.partition(" ")[0] for line in packed if line.endswith(f" {name}")), "")
    except (OSError, UnicodeDecodeError):
        return ""


def _can_be_imported(module: str) -> bool:
    """Return whether a module can be imported."""
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):  # a stand-in without a spec
        return module in sys.modules


def _top_level_modules(root: Path) -> dict[str, Path | None]:
    """Return the top-level module names in a folder -> the package folder if it has no
    ``__init__.py``, else None.

    Python prefers any other package of the same name on the path to such a package, so it is
    created explicitly.
    """
    names: dict[str, Path | None] = {}
    for place in root.iterdir() if root.is_dir() else ():
        if place.is_dir() and place.name.isidentifier():
            if (place / "__init__.py").is_file():
                names[place.name] = None
            elif any(place.glob("*.py")) or any(place.glob("*/*.py")):
                names[place.name] = place
        elif place.suffix == ".py" and place.stem.isidentifier():
            names[place.stem] = None
    return {name: place for name, place in names.items() if name not in sys.stdlib_module_names}


def _digest_of_code(root: Path) -> str:
    """Return a hash of the names and contents of code and configuration in a folder.

    Hidden folders, Python environments and large files are skipped. Of the links to folders, only
    packages are followed.
    """
    digest = hashlib.sha256()
    left = [root]
    followed = {root.resolve()}
    for folder, folders, names in chain.from_iterable(map(os.walk, left)):
        folders[:] = sorted(name for name in folders if not name.startswith((".", "__pycache__")))
        if "pyvenv.cfg" in names or "conda-meta" in folders:
            folders.clear()
            continue
        for linked in (
            path for path in (Path(folder, name) for name in folders) if path.is_symlink()
        ):
            if linked.resolve() not in followed and (
                any(linked.glob("*.py")) or any(linked.glob("*/*.py"))
            ):
                followed.add(linked.resolve())
                left.append(linked)
        for path in (Path(folder, name) for name in sorted(names) if name.endswith(_CODE)):
            if path.is_file() and path.stat().st_size < _MAX_CODE_BYTES:
                content = path.read_bytes()
                digest.update(
                    f"{path.relative_to(root).as_posix()} {len(content)};".encode() + content
                )
    return digest.hexdigest()


def _empty_package(folder: Path) -> ModuleType:
    """Create an empty package module for a folder."""
    module = ModuleType(folder.name)
    module.__path__ = [str(folder)]
    module.__package__ = folder.name
    return module


def _pop_modules(names: Mapping[str, Path | None]) -> dict[str, ModuleType]:
    """Remove the modules with these top-level names from ``sys.modules`` and return them."""
    names_loaded = [key for key in sys.modules if key.partition(".")[0] in names]
    return {key: sys.modules.pop(key) for key in names_loaded}
