"""Weight manifests: TOML files in which a plugin describes its weight sets, one table for each set.

::

    [moge-2-vits-normal]
    summary = "MoGe-2 ViT-S: metric points, normals, focal length"
    license = "MIT"
    commercial = true      # omit if the licence does not state it
    account = false        # whether an account with granted access is required
    homepage = "https://huggingface.co/Ruicheng/moge-2-vits-normal-onnx"
    advice = ""            # how to get files that have no source
    # repositories of Hugging Face with the same files, tried after the source
    mirrors = []
    # backends that use the set unless an option names another
    default_of = ["metric_depth.moge-2-onnx"]
    needs = ""             # what these backends need besides, such as "a GPU"
    [[moge-2-vits-normal.files]]
    path = "model.onnx"    # relative to the folder of the set
    bytes = 140852051
    sha256 = "24ea..."
    source = "hf://Ruicheng/moge-2-vits-normal-onnx/model.onnx"

A source is ``hf://owner/repository/path``, optionally followed by ``@revision``, or a web address.
For a file inside a zip, add ``#member`` to the address: the member's path, or the end of it if that
is unique. The user has to provide a file without a source.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from types import MappingProxyType
from typing import Annotated

from pydantic import AfterValidator, ConfigDict, Field, Strict, StrictBool, TypeAdapter

from physic_core.errors import BackendError
from physic_core.files.text import parse_toml

_HUB = re.compile(r"hf://([\w.-]+/[\w.-]+)/([^@#?]+)(?:@([\w./-]+))?")
_WEB = re.compile(r"https?://[^\s/#?]+/[^\s#]*(?:#(.+))?")
_COMMIT = re.compile(r"[0-9a-f]{40}")
_TABLE = ConfigDict(extra="forbid")


def is_inside(path: str) -> bool:
    """Return whether a relative path stays inside its folder, on every operating system."""
    parts = PurePosixPath(path).parts
    plain = not (
        path.startswith("/")
        or "\\" in path
        or ":" in path
        or "\0" in path
        or PureWindowsPath(path).drive
    )
    return plain and bool(parts) and ".." not in parts and not path.endswith("/")


def _check_path(path: str) -> str:
    if not is_inside(path):
        raise ValueError("should be inside the folder of the set")
    return path


def _check_source(source: str) -> str:
    hub = _HUB.fullmatch(source)
    web = _WEB.fullmatch(source)
    named = hub[2] if hub else ""
    inside = web[1] if web else named
    if source and not (inside is None or is_inside(inside)):
        raise ValueError(
            "should be hf://owner/repository/path[@revision] or https://host/path[#member]"
        )
    return source


_Text = Annotated[str, Field(min_length=1)]


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

    __pydantic_config__ = _TABLE

    path: Annotated[str, AfterValidator(_check_path)]
    bytes: Annotated[int, Strict(), Field(gt=0, lt=2**63)] | None = None
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = None
    source: Annotated[str, AfterValidator(_check_source)] = ""

    @property
    def is_pinned(self) -> bool:
        """Whether the manifest has a SHA-256, or the commit of a Hugging Face repository."""
        origin = self.origin
        commit = isinstance(origin, HubSource) and _COMMIT.fullmatch(origin.revision) is not None
        return self.sha256 is not None or commit

    @property
    def origin(self) -> HubSource | WebSource | None:
        """The parsed source, or None if there is none."""
        if match := _HUB.fullmatch(self.source):
            return HubSource(match[1], match[2], match[3] or "main")
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
        mirrors: "owner/name" of Hugging Face repositories that hold the same files, wherever inside
            and under whatever name: a file is recognised by its SHA-256. They are tried after the
            source, in this order.
        default_of: "INTERFACE.NAME" of the backends that use the set unless an option names
            another.
        needs: what its backends need besides files and packages, separated by commas, such as "a
            GPU".
        files: at least one; with mirrors, all have a SHA-256.
    """

    __pydantic_config__ = _TABLE

    name: Annotated[str, Field(pattern="^[a-z0-9]+([._-][a-z0-9]+)*$")]
    summary: _Text
    license: _Text
    commercial: StrictBool | None = None
    account: StrictBool = False
    homepage: str = ""
    advice: str = ""
    mirrors: tuple[Annotated[str, Field(pattern=r"^[\w.-]+/[\w.-]+$")], ...] = ()
    default_of: tuple[_Text, ...] = ()
    needs: str = ""
    files: tuple[WeightFile, ...] = ()

    @property
    def bytes(self) -> int | None:
        """Total size of all files, or None if one size is unknown."""
        sizes = [file.bytes for file in self.files]
        return None if None in sizes else sum(size for size in sizes if size is not None)

    @property
    def is_free(self) -> bool:
        """Whether the licence allows commercial use, and no account is required."""
        return self.commercial is True and not self.account

    @property
    def needs_account(self) -> bool:
        """Whether getting the files requires an account."""
        return self.account and not self.mirrors

    def how_to_get(self) -> str:
        """Return the command or the advice to get the files."""
        if not any(file.source for file in self.files):
            return self.advice
        command = f"`physic weights fetch {self.name}`"
        if not self.is_free:
            account = "an account with access, " if self.needs_account else ""
            command = (
                f"`physic weights fetch {self.name} --accept-license` ({account}commercial "
                f"use {self._commercial_use()})"
            )
        return command if all(file.source for file in self.files) else f"{command}; {self.advice}"

    def describe_licence(self) -> str:
        """Format the licence, and how to get access to the files, as lines of text."""
        lines = [f"  license     {self.license}", f"  commercial  use {self._commercial_use()}"]
        if self.account:
            login = "log in there (for Hugging Face by `hf auth login` or HF_TOKEN)"
            need = "needed" if self.needs_account else "only for the first source"
            lines.append(f"  account     {need}: request access at {self.homepage}, and {login}")
        elif self.homepage:
            lines.append(f"  homepage    {self.homepage}")
        if self.mirrors:
            lines.append(
                f"  mirrors     the same files, compared by SHA-256: {', '.join(self.mirrors)}"
            )
        return "\n".join(lines)

    def _commercial_use(self) -> str:
        return {True: "allowed", False: "NOT allowed", None: "not stated: read the license"}[
            self.commercial
        ]


def read_manifest(path: Path) -> Mapping[str, WeightSet]:
    """Read the weight sets of a TOML file, or of all TOML files in a folder, by name.

    The result is cached until a file changes.

    Raises:
        BackendError: a file is missing or invalid.
    """
    path = Path(path)
    try:
        files = tuple(sorted(path.glob("*.toml"))) if path.is_dir() else (path,)
        return _read_manifests(
            tuple((file, file.stat().st_mtime_ns, file.stat().st_size) for file in files)
        )
    except OSError as error:
        raise BackendError(
            f"the weight manifest {path} cannot be read: {error.strerror}"
        ) from error


_SETS = TypeAdapter(dict[str, WeightSet])


@functools.lru_cache(maxsize=64)
def _read_manifests(stamps: tuple[tuple[Path, int, int], ...]) -> Mapping[str, WeightSet]:
    sets: dict[str, WeightSet] = {}
    for file, _, _ in stamps:
        try:
            tables = parse_toml(file.read_text(encoding="utf-8"))
            named = {
                name: {"name": name, **table} if isinstance(table, dict) else table
                for name, table in tables.items()
            }
            found = _SETS.validate_python(named)
            for name, weights in found.items():
                if name in sets:
                    raise ValueError(f"[{name}] is in another manifest already")
                _check_files(weights)
        except ValueError as error:  # also of TOML, UTF-8 and pydantic
            raise BackendError(f"the weight manifest {file} is invalid: {error}") from error
        sets |= found
    return MappingProxyType(sets)


def _check_files(weights: WeightSet) -> None:
    """Raise ValueError if files of a set contradict each other, or cannot be had."""
    paths = [file.path for file in weights.files]
    if not paths or len(set(paths)) < len(paths):
        raise ValueError(f"[{weights.name}] has no files, or one of them twice")
    for file in weights.files:
        if file.source.startswith("http://") and file.sha256 is None:
            raise ValueError(
                f"[{weights.name}] {file.source} is not secure: add its sha256, or use https://"
            )
        if weights.mirrors and file.sha256 is None:
            raise ValueError(
                f"[{weights.name}] has mirrors: add the sha256 of {file.path}, by which it is "
                f"found there"
            )
        if not (file.source or weights.advice):
            raise ValueError(
                f"[{weights.name}] has no source for {file.path}: write in 'advice' how to get it"
            )
