"""Weight manifests: TOML files in which a plugin describes its weight sets, one table for each set.

::

    [moge-2-vits-normal]
    summary = "MoGe-2 ViT-S: metric points, normals, focal length"
    license = "MIT"
    commercial = true      # leave out if the licence does not state it
    account = false        # whether an account with granted access is required
    homepage = "https://huggingface.co/Ruicheng/moge-2-vits-normal-onnx"
    advice = ""            # how to get files that have no source
    [[moge-2-vits-normal.files]]
    path = "model.onnx"    # relative to the folder of the set
    bytes = 140852051
    sha256 = "24ea..."
    source = "hf://Ruicheng/moge-2-vits-normal-onnx/model.onnx"

A source is ``hf://owner/repository/path``, optionally followed by ``@revision``, or a web address. For a file inside a
zip, add ``#member`` to the address: the member's path, or the end of it if that is unique. The user has to provide a
file without a source.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path, PurePosixPath, PureWindowsPath
from types import MappingProxyType
from typing import Any

from physic_core.errors import BackendError

__all__ = ["HubSource", "WebSource", "WeightFile", "WeightSet", "is_inside", "read_manifest"]

_NAME = re.compile(r"[a-z0-9]+([._-][a-z0-9]+)*")
_HUB = re.compile(r"hf://([\w.-]+/[\w.-]+)/([^@#?]+)(?:@([\w./-]+))?")
_WEB = re.compile(r"https?://[^\s/#?]+/[^\s#]*(?:#(.+))?")
_MAX_BYTES = 2**63
_MAX_SHOWN = 80
_HASH = re.compile(r"[0-9a-f]{64}")
_COMMIT = re.compile(r"[0-9a-f]{40}")


@dataclass(frozen=True)
class HubSource:
    """A file in a Hugging Face repository.

    Attributes:
        repository: "owner/name".
        path: relative to the repository.
        revision: branch, tag or commit.
    """

    repository: str
    path: str
    revision: str = "main"


@dataclass(frozen=True)
class WebSource:
    """A file at a web address.

    Attributes:
        url: of the file, or of the zip that contains it.
        member: path inside the zip, or the end of that path; "" if the URL is the file itself.
    """

    url: str
    member: str = ""


@dataclass(frozen=True)
class WeightFile:
    """Path, size, hash and source of one weight file.

    Attributes:
        path: relative to the folder of the set, with "/".
        bytes: published size; None if unknown.
        sha256: published SHA-256, 64 hexadecimal digits; None if unknown.
        source: address of the download; "" if the user has to provide the file.
    """

    path: str
    bytes: int | None = None
    sha256: str | None = None
    source: str = ""

    @property
    def is_pinned(self) -> bool:
        """Whether the manifest has a SHA-256, or the commit of a Hugging Face repository."""
        origin = self.origin
        commit = isinstance(origin, HubSource) and _COMMIT.fullmatch(origin.revision) is not None
        return self.sha256 is not None or commit

    @property
    def origin(self) -> HubSource | WebSource | None:
        """The parsed source, or None if there is none."""
        if found := _HUB.fullmatch(self.source):
            return HubSource(found[1], found[2], found[3] or "main")
        if self.source:
            url, _, member = self.source.partition("#")
            return WebSource(url, member)
        return None


@dataclass(frozen=True)
class WeightSet:
    """The weight files of one network.

    Attributes:
        name: name in options and commands.
        summary: one line.
        license: name of the licence.
        commercial: whether the licence allows commercial use; None if it does not state it.
        account: whether an account with granted access is required for the download.
        homepage: URL with more information.
        advice: how to get files that have no source.
        files: at least one.
    """

    name: str
    summary: str
    license: str
    commercial: bool | None
    account: bool
    homepage: str
    advice: str
    files: tuple[WeightFile, ...]

    @property
    def bytes(self) -> int | None:
        """Total size of all files, or None if one size is unknown."""
        sizes = [file.bytes for file in self.files]
        return None if None in sizes else sum(size for size in sizes if size is not None)

    @property
    def is_free(self) -> bool:
        """Whether the licence allows commercial use, and no account is required."""
        return self.commercial is True and not self.account


def read_manifest(path: Path) -> Mapping[str, WeightSet]:
    """Read the weight sets of a TOML file, or of all TOML files in a folder, by name.

    The result is cached until a file changes.

    Raises:
        BackendError: the file is missing or invalid; the message lists all errors.
    """
    path = Path(path)
    files = tuple(sorted(path.glob("*.toml"))) if path.is_dir() else (path,)
    try:
        stamps = tuple((file, file.stat().st_mtime_ns, file.stat().st_size) for file in files)
    except OSError as error:
        raise BackendError(f"the weight manifest {path} cannot be read: {error.strerror}") from error
    return _read(stamps)


def is_inside(path: str) -> bool:
    """Return whether a relative path stays inside its folder, on every operating system."""
    parts = PurePosixPath(path).parts
    plain = not (path.startswith("/") or "\\" in path or ":" in path or "\0" in path or PureWindowsPath(path).drive)
    return plain and bool(parts) and ".." not in parts and not path.endswith("/")


def _printable(path: str) -> str:
    """Return a path for messages, with control characters escaped."""
    return path if path.isprintable() else ascii(path)[1:-1]


@functools.lru_cache(maxsize=64)
def _read(stamps: tuple[tuple[Path, int, int], ...]) -> Mapping[str, WeightSet]:
    import tomllib

    sets: dict[str, WeightSet] = {}
    owner: dict[str, Path] = {}
    faults: list[str] = []
    for file, _, _ in stamps:
        try:
            tables = tomllib.loads(file.read_text(encoding="utf-8"))
        except OSError as error:
            raise BackendError(f"the weight manifest {file} cannot be read: {error.strerror}") from error
        except ValueError as error:  # no TOML, or no UTF-8
            faults.append(f"{file}: {ascii(str(error))[1:-1]}")
            continue
        except RecursionError:
            faults.append(f"{file}: its arrays or tables are nested too deeply")
            continue
        for name, table in tables.items():
            found: list[str] = []
            if name in owner:
                found.append(f"is in {owner[name].name} already")
            made = _set(name, table, found)
            faults += [f"{file}: [{_shown(name)[1:-1]}] {fault}" for fault in found]
            if made is not None and not found:
                sets[name], owner[name] = made, file
    if faults:
        raise BackendError("\n".join(["this weight manifest is invalid:", *faults]))
    return MappingProxyType(sets)


_KEYS: dict[str, tuple[type, bool, str]] = {
    "summary": (str, True, "a text"),
    "license": (str, True, "a text"),
    "commercial": (bool, False, "true or false"),
    "account": (bool, False, "true or false"),
    "homepage": (str, False, "a text"),
    "advice": (str, False, "a text"),
    "files": (list, True, "a list of tables"),
}
_FILE_KEYS: dict[str, tuple[type, bool, str]] = {
    "path": (str, True, "a text"),
    "bytes": (int, False, "a whole number"),
    "sha256": (str, False, "a text"),
    "source": (str, False, "a text"),
}


def _set(name: str, table: Any, faults: list[str]) -> WeightSet | None:
    """Parse the table of one weight set; errors are appended to ``faults``."""
    if not _NAME.fullmatch(name):
        faults.append("should be of a-z, 0-9, and single hyphens, dots or underscores between them")
    if not isinstance(table, dict):
        faults.append(f"should be a table, got {_shown(table)}")
        return None
    if not _keys(table, _KEYS, "", faults):
        return None
    if not table["files"]:
        faults.append("has no files")
    files = []
    for i, entry in enumerate(table["files"]):
        if (file := _file(entry, f"files[{i}] ", faults)) is not None:
            files.append(file)
    for twice in sorted({f.path for f in files if sum(f.path == g.path for g in files) > 1}):
        faults.append(f"has the file {_printable(twice)} more than once")
    by_hand = [_printable(file.path) for file in files if not file.source]
    if by_hand and not table.get("advice"):
        faults.append(f"has no source for {', '.join(by_hand)}: write in 'advice' how to get it")
    return WeightSet(
        name=name,
        summary=table["summary"],
        license=table["license"],
        commercial=table.get("commercial"),
        account=table.get("account", False),
        homepage=table.get("homepage", ""),
        advice=table.get("advice", ""),
        files=tuple(files),
    )


def _file(entry: Any, at: str, faults: list[str]) -> WeightFile | None:
    if not isinstance(entry, dict):
        faults.append(f"{at}should be a table, got {_shown(entry)}")
        return None
    if not _keys(entry, _FILE_KEYS, at, faults):
        return None
    path, size, digest, source = entry["path"], entry.get("bytes"), entry.get("sha256"), entry.get("source", "")
    if not is_inside(path):
        faults.append(f"{at}path should be inside the folder of the set, got {_shown(path)}")
    if size is not None and not 0 < size < _MAX_BYTES:
        faults.append(f"{at}bytes should be > 0{'' if size <= 0 else ' and below 2**63'}, got {_shown(size)}")
    if digest is not None and not _HASH.fullmatch(digest):
        faults.append(f"{at}sha256 should be 64 digits of 0-9 and a-f, got {_shown(digest)}")
    if source and not _is_source(source):
        faults.append(
            f"{at}source should be hf://owner/repository/path[@revision] or https://host/path[#member], "
            f"got {_shown(source)}"
        )
    elif source.startswith("http://") and digest is None:
        faults.append(f"{at}source is http://, which is not secure: add its sha256, or use https://")
    return WeightFile(path, size, digest, source)


def _is_source(source: str) -> bool:
    if found := _HUB.fullmatch(source):
        return is_inside(found[2])
    found = _WEB.fullmatch(source)
    return found is not None and (found[1] is None or is_inside(found[1]))


def _keys(table: Mapping[str, Any], known: Mapping[str, tuple[type, bool, str]], at: str, faults: list[str]) -> bool:
    """Return whether a table has all required keys with the right types; errors are appended to ``faults``."""
    before = len(faults)
    for key in table:
        if key not in known:
            close = get_close_matches(key, known, n=1)
            faults.append(f"{at}has an unknown key {_shown(key)}" + (f". Did you mean '{close[0]}'?" if close else ""))
    for key, (kind, needed, words) in known.items():
        if key not in table:
            if needed:
                faults.append(f"{at}has no {key}")
        elif not isinstance(table[key], kind) or (kind is int and isinstance(table[key], bool)):
            faults.append(f"{at}{key} should be {words}, got {_shown(table[key])}")
        elif needed and kind is str and not table[key].strip():
            faults.append(f"{at}{key} should not be empty")
    return len(faults) == before


def _shown(value: Any) -> str:
    """Return a value as one line of ASCII, of at most 80 characters."""
    try:
        text = ascii(value)
    except (ValueError, RecursionError):  # an integer of thousands of digits, or deep tables
        return f"a {type(value).__name__}"
    return text if len(text) <= _MAX_SHOWN else f"{text[: _MAX_SHOWN - 3]}..."
