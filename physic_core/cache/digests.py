"""Digests of the inputs of backends, of the source code of their classes, and of the user's files.

Results of older code are not reused: a version number identifies the code of an installed release,
but not that of a plugin under development. Large files are read once, also by several processes,
until they change.
"""

from __future__ import annotations

import hashlib
import os
import re
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_core.cache.folders import claimed_cache
from physic_core.discovery.entry_points import versions_of
from physic_core.errors import OutputError
from physic_core.files.atomic import atomic_write

if TYPE_CHECKING:
    from physic_core.types import AnyArray


_BYTES = 20
_STARTED = time.time()
"""Start time of this process; files modified later may differ from the imported code."""

_CODE_BYTES = 16
_IMPORTED = re.compile(rb"(?:\n|[;:])[ \t]*(?:from[ \t]+(\w+)|import[ \t]+([\w., \t]+))")
_IMPORTS_BY_NAME = re.compile(rb"importlib|__import__|pkgutil")
_FIRST_TEXT = re.compile(rb"\w\(\s*[\"'](\w+)[\"'.]")  # of a call
_NAME = re.compile(rb"[\"']([\w./ -]+)[\"']")
_MODULES = {".py", ".so", ".pyd"}
_OURS = "physic_"
_INSTALLED = {"site-packages", "dist-packages"}
_MAX_FILES = 2000
"""Maximum number of files of a package whose content counts; of others their sizes and times."""

_MAX_NAMED_FILES = 20_000
"""Maximum number of files of a package, or of a folder that settings name."""


class Digester:
    """Computes digests of values by content; each array is read only once."""

    def __init__(self) -> None:
        self._arrays: dict[int, tuple[AnyArray, bytes]] = {}

    def digest(self, *values: object) -> str:
        """Compute a hexadecimal digest of arrays, numbers, strings, tuples, lists, mappings and
        dataclasses.

        Arrays must not be modified while this object is in use.

        Raises:
            TypeError: a value has another type.
        """
        hasher = hashlib.blake2b(digest_size=_BYTES)
        self._update_hash(hasher, values)
        return hasher.hexdigest()

    def _update_hash(self, hasher: Any, value: Any) -> None:
        """Add type, length and content of a value to a hash."""
        import numpy as np  # imported here, since looking up the hash of a file does not need it

        if isinstance(value, np.ndarray):
            hasher.update(
                f"array {value.dtype.str} {value.shape};".encode() + self._array_bytes(value)
            )
        elif value is None or isinstance(value, bool | int | float | np.generic):
            text = repr(value)
            hasher.update(f"number {len(text)} {text};".encode())
        elif isinstance(value, str):
            encoded = value.encode("utf-8", "surrogatepass")
            hasher.update(f"text {len(encoded)};".encode() + encoded)
        elif is_dataclass(value) and not isinstance(value, type):
            parts = {
                field.name: getattr(value, field.name) for field in fields(value) if field.init
            }
            hasher.update(f"dataclass {type(value).__name__};".encode())
            self._update_hash(hasher, parts)
        elif isinstance(value, Mapping):
            hasher.update(f"mapping {len(value)};".encode())
            for key in sorted(value):
                self._update_hash(hasher, key)
                self._update_hash(hasher, value[key])
        elif isinstance(value, tuple | list):
            hasher.update(f"sequence {len(value)};".encode())
            for item in value:
                self._update_hash(hasher, item)
        else:
            raise TypeError(f"{type(value).__name__} has no digest.")

    def _array_bytes(self, array: AnyArray) -> bytes:
        import numpy as np

        remembered = self._arrays.get(id(array))
        if remembered is not None:
            return remembered[1]
        if array.dtype.hasobject:
            raise TypeError("an array of Python objects has no digest.")
        digest = hashlib.blake2b(
            np.ascontiguousarray(array).reshape(-1).view(np.uint8).data, digest_size=_BYTES
        )
        # The array is stored too, so that no other array gets its id.
        self._arrays[id(array)] = (array, digest.digest())
        return digest.digest()


class CodeDigester:
    """Computes digests of the source code of classes; the files of each package are read only
    once.
    """

    def __init__(self) -> None:
        self._code_files: dict[Path, list[Path]] = {}
        self._read_sha256: dict[Path, _Code | None] = {}

    def digest(self, kind: type) -> str | None:
        """Compute the digest of the packages that define a class and its bases, and of all that
        these import but the standard library. Of distributions that are installed, only the
        packages ``physic_*`` count; of others the version, which those packages require anyway.

        All files count with their content, so that two installations agree. For a module outside
        any package, the modules in the same folder count, and the files that their texts name; of
        folders that they name, names, sizes and times of the files.

        Returns:
            The digest. None if there is no reliable one: the class is defined in a function or an
                interactive session, or its files were modified after this process started.
        """
        modules: list[Path] = []
        for base in kind.__mro__:
            top = base.__module__.partition(".")[0]
            if top in sys.stdlib_module_names or (modules and not _uninstalled_modules(top)):
                continue
            file = getattr(sys.modules.get(base.__module__), "__file__", None)
            if file is None or top == "__main__" or "<locals>" in base.__qualname__:
                return None
            modules.append(Path(file))
        return self.digest_of(modules)

    def digest_of(self, modules: list[Path]) -> str | None:
        """Compute the digest of the packages of modules, as :meth:`digest` does."""
        modules = [*modules]
        known = set(modules)
        counted = set[bytes]()
        digest = hashlib.blake2b(digest_size=_CODE_BYTES)
        for module in modules:  # which grows
            try:
                code = self._module(module)
            except (OSError, ValueError):  # in an archive, or gone
                code = None
            if code is None:
                return None
            if code.digest in counted:
                continue
            counted.add(code.digest)
            digest.update(code.digest)
            modules += (new := [path for path in code.imported if path not in known])
            known.update(new)
        return digest.hexdigest()

    def _module(self, module: Path) -> _Code | None:
        package = _package(module)
        if package not in self._code_files:
            self._code_files[package] = _code_files(package)
        files = self._code_files[package]
        place = package if files else module
        if place not in self._read_sha256:
            self._read_sha256[place] = _read_code(files or [module])
        return self._read_sha256[place]


def _package(module: Path) -> Path:
    """Return the folder of the top-level package that contains a module; that of the module outside
    any package.
    """
    root = module.parent
    while (root.parent / "__init__.py").is_file():  # a folder within a package may have none
        root = root.parent
    return root


def _code_files(root: Path) -> list[Path]:
    """Return the files of a package; the modules of a folder that is not a package."""
    if not (root / "__init__.py").is_file():
        return sorted(path for path in root.iterdir() if path.suffix in _MODULES and path.is_file())
    return list(islice(_files_below(root), _MAX_NAMED_FILES + 1))


def _files_below(root: Path) -> Iterator[Path]:
    """Yield the regular files of a folder, sorted; each folder once, also where links lead to."""
    seen = set[str]()
    for folder, folders, names in os.walk(root, followlinks=True):
        is_new = (real := os.path.realpath(folder)) not in seen
        seen.add(real)
        folders[:] = sorted(name for name in folders if is_new and name != "__pycache__")
        paths = (Path(folder, name) for name in sorted(names) if is_new)
        yield from (path for path in paths if path.is_file())  # a pipe would be waited for


@dataclass(frozen=True)
class _Code:
    """Digest of the files of a package, and the modules that they import and that count."""

    digest: bytes
    imported: tuple[Path, ...]


def _read_code(files: list[Path]) -> _Code | None:
    """Read the files of a package; None if one was modified after this process started."""
    digest = hashlib.blake2b(digest_size=_CODE_BYTES)
    imported: set[str] = set()
    files = [*files]
    counted = set(files)
    is_declared = files[0].parent.name.startswith(_OURS)  # its distribution states requirements
    for count, path in enumerate(files):  # which grows
        if path.is_dir():  # maybe of photos: too much to read
            digest.update(os.fsencode(f"{path.name} {_folder_stamp(path)};"))
            continue
        if count >= _MAX_FILES:
            digest.update(os.fsencode(f"{path.name} {file_stamp(path.stat())};"))
            continue
        is_source = path.suffix == ".py"
        if is_source and _STARTED < path.stat().st_mtime <= time.time():
            return None
        content = path.read_bytes() if is_source else remembered_sha256(path).encode()
        digest.update(os.fsencode(f"{path.name} {len(content)};") + content)
        if is_source:
            imported |= _imported(content)
            named = [] if is_declared else _files_named_in(content, path.parent)
            files += (new := [one for one in named if one not in counted])
            counted.update(new)
    if len(files) > _MAX_NAMED_FILES:
        return None
    paths: list[Path] = []
    for name in sorted(imported - sys.stdlib_module_names):
        paths += (found := _uninstalled_modules(name))
        if not found and not is_declared:
            digest.update(f"{name} {versions_of(name)};".encode())
    return _Code(digest.digest(), tuple(dict.fromkeys(paths)))


def _imported(source: bytes) -> set[str]:
    """Return the top-level names that a module imports, or may import by the first text of a
    call.
    """
    source = b"\n" + re.sub(rb"\\\r?\n", b"", source)
    statements = _IMPORTED.findall(source)
    names = {one.split()[0] for _, some in statements for one in some.split(b",") if one.split()}
    names |= {name for name, _ in statements if name}
    if _IMPORTS_BY_NAME.search(source):
        names |= {*_FIRST_TEXT.findall(source)}
    return {name.partition(b".")[0].decode(errors="replace") for name in names}


def _files_named_in(source: bytes, folder: Path) -> list[Path]:
    """Return the files that a text of a module in a folder names, and the folders in it, unless it
    is one of a package, whose files all count.
    """
    in_package = (folder / "__init__.py").is_file()
    found: list[Path] = []
    for name in sorted({name.decode() for name in _NAME.findall(source)}):
        place = os.path.join(folder, name)
        if not os.path.exists(place):
            continue
        path = Path(os.path.normpath(place))
        is_inside = folder in path.parents
        is_file = path.is_file() and (is_inside or path.suffix)  # not /proc/stat
        if is_file or (is_inside and not in_package and path.is_dir()):
            found.append(path)
    return found


def _uninstalled_modules(name: str) -> list[Path]:
    """Return the modules of a top-level name whose code counts: one, or all in the folders of a
    package without ``__init__.py``; none if it is installed, or missing.

    It is not imported.
    """
    spec = None
    with suppress(ImportError, ValueError):
        spec = find_spec(name)
    if spec is None:
        return []
    is_single_file = spec.has_location and spec.origin is not None
    paths = (
        [Path(spec.origin or "")]
        if is_single_file
        else map(Path, spec.submodule_search_locations or ())
    )
    own_code = [
        place for place in paths if name.startswith(_OURS) or _INSTALLED.isdisjoint(place.parts)
    ]
    if is_single_file:
        return [place for place in own_code if place.suffix in _MODULES]
    return [path for place in own_code for path in islice(sorted(place.rglob("*.py")), _MAX_FILES)]


_known: dict[str, str] = {}


def file_stamp(status: os.stat_result) -> str:
    """Return size in bytes, times of the last change of content and of inode (ns since 1970), and
    inode of a file: as long as they are the same, so is its content.

    No user can set the time of the inode.
    """
    return f"{status.st_size} {status.st_mtime_ns} {status.st_ctime_ns} {status.st_ino}"


_CLOCK_NS = 2_000_000_000
"""A file can change twice within one step of its clock, which is up to 2 s (FAT)."""


def remembered_sha256(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits, from the cache if the file has not
    changed: see :func:`file_stamp`.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        status = os.fstat(file.fileno())
        stamp = f"{status.st_dev} {file_stamp(status)}"
        name = hashlib.sha256(os.fsencode(f"{path.resolve()} {stamp}")).hexdigest()[:32]
        digest = _known.get(name) or _read_sha256(name)
        if digest is None:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            if status.st_ctime_ns < time.time_ns() - _CLOCK_NS:
                _known[name] = digest
                _write_sha256(name, digest)
    return digest


def files_named_by(settings: Any) -> Iterator[tuple[str, str]]:
    """Yield path and SHA-256 of every file that a text in settings names; of a folder, its files'
    names and stamps.

    Args:
        settings: a text, or mappings, lists and tuples of settings.
    """
    if isinstance(settings, Mapping):
        settings = list(settings.values())
    if isinstance(settings, tuple | list):
        for value in settings:
            yield from files_named_by(value)
    elif isinstance(settings, str):
        with suppress(OSError, ValueError):  # a text that cannot be a path
            path = Path(os.path.expanduser(settings))
            if path.is_file():
                yield str(path.absolute()), remembered_sha256(path)
            elif path.parts and path.is_dir():
                yield str(path.absolute()), _folder_stamp(path)


def _folder_stamp(folder: Path) -> str:
    """Return the digest of the names and stamps of all files of a folder; of one with very many
    files, a digest that no other call returns.
    """
    digest = hashlib.blake2b(digest_size=_BYTES)
    for count, path in enumerate(_files_below(folder)):
        if count == _MAX_NAMED_FILES:
            return f"{os.getpid()} {time.time_ns()}"
        digest.update(f"{path.relative_to(folder)} ".encode("utf-8", "surrogateescape"))
        digest.update(file_stamp(path.stat()).encode())
    return digest.hexdigest()


def _read_sha256(name: str) -> str | None:
    kept = claimed_cache("hashes")
    if kept is None:
        return None
    try:
        text = (kept.path / f"{name}{kept.suffix}").read_text("ascii")
    except (OSError, ValueError):
        return None
    kept.mark_used(f"{name}{kept.suffix}")
    return text if re.fullmatch("[0-9a-f]{64}", text) else None


_MAX_BYTES = 1 << 16
"""All kept hashes have at most this size, which is 1000 files."""


def _write_sha256(name: str, sha256: str) -> None:
    kept = claimed_cache("hashes")
    with suppress(OSError, OutputError):  # it can be computed again
        if kept is not None:
            with atomic_write(kept.path, lock=False) as temporary:
                part = temporary(f"{name}{kept.suffix}")
                part.touch(mode=0o600)
                part.write_text(sha256, "ascii")
            kept.trim(_MAX_BYTES)
