"""Weight manifests: TOML files in which a plugin describes its weight sets, one table for each set.

::

    [moge-2-vits-normal]
    summary = "MoGe-2 ViT-S: metric points, normals, focal length"
    license = "MIT"
    commercial = true      # omit if the licence does not state it
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
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from types import MappingProxyType
from typing import Annotated, Any

from pydantic import AfterValidator, ConfigDict, Field, Strict, StrictBool, TypeAdapter, ValidationError

from physic_core.errors import BackendError

LOGIN = "log in with `hf auth login`, or set HF_TOKEN"

_HUB = re.compile(r"hf://([\w.-]+/[\w.-]+)/([^@#?]+)(?:@([\w./-]+))?")
_WEB = re.compile(r"https?://[^\s/#?]+/[^\s#]*(?:#(.+))?")
_MAX_SHOWN = 80
_COMMIT = re.compile(r"[0-9a-f]{40}")
_TABLE = ConfigDict(extra="forbid")


def is_inside(path: str) -> bool:
    """Return whether a relative path stays inside its folder, on every operating system."""
    parts = PurePosixPath(path).parts
    plain = not (path.startswith("/") or "\\" in path or ":" in path or "\0" in path or PureWindowsPath(path).drive)
    return plain and bool(parts) and ".." not in parts and not path.endswith("/")


def _check_path(path: str) -> str:
    if not is_inside(path):
        raise ValueError("should be inside the folder of the set")
    return path


def _check_source(source: str) -> str:
    hub, web = _HUB.fullmatch(source), _WEB.fullmatch(source)
    inside = hub[2] if hub else web[1] if web else ""
    if source and not (inside is None or is_inside(inside)):
        raise ValueError("should be hf://owner/repository/path[@revision] or https://host/path[#member]")
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

    __pydantic_config__ = _TABLE

    name: Annotated[str, Field(pattern="^[a-z0-9]+([._-][a-z0-9]+)*$")]
    summary: _Text
    license: _Text
    commercial: StrictBool | None = None
    account: StrictBool = False
    homepage: str = ""
    advice: str = ""
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

    def how_to_get(self) -> str:
        """Return the command or the advice to get the files."""
        if not any(file.source for file in self.files):
            return self.advice
        command = f"`physic weights fetch {self.name}"
        if self.is_free:
            way = f"{command}`"
        else:
            why = "an account with access, " if self.account else ""
            use = {True: "commercial use allowed", False: "no commercial use", None: "commercial use not stated"}
            way = f"{command} --accept-licence` ({why}{use[self.commercial]})"
        return way if all(file.source for file in self.files) else f"{way}; {self.advice}"

    def describe_licence(self) -> str:
        """Format the licence, and how to get access to the files, as lines of text."""
        use = {True: "is allowed", False: "is NOT allowed", None: "is not stated: read the licence"}
        lines = [f"  licence     {self.license}", f"  commercial  use {use[self.commercial]}"]
        if self.account:
            hub = [file.origin.repository for file in self.files if isinstance(file.origin, HubSource)]
            is_gated = len(hub) == len(self.files)  # else the account is for the files that have no source
            page = f"https://huggingface.co/{hub[0]}" if is_gated else self.homepage
            login = LOGIN if is_gated else "log in there"
            lines.append(f"  account     needed: request access at {page}, and {login}")
        if self.homepage:
            lines.append(f"  homepage    {self.homepage}")
        return "\n".join(lines)


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
            if name in owner:
                faults.append(f"{file}: [{_shown(name)[1:-1]}] is in {owner[name].name} already")
                continue
            try:
                made = _SETS.validate_python({"name": name, **table} if isinstance(table, dict) else table)
                found = list(_contradictions(made))
            except ValidationError as error:
                found = [_describe(problem) for problem in error.errors(include_url=False)]
            faults += [f"{file}: [{_shown(name)[1:-1]}] {fault}" for fault in found]
            if not found:
                sets[name], owner[name] = made, file
    if faults:
        raise BackendError("\n".join(["this weight manifest is invalid:", *faults]))
    return MappingProxyType(sets)


_SETS = TypeAdapter(WeightSet)


def _contradictions(weights: WeightSet) -> Iterator[str]:
    """Yield what is wrong with the files of a set beside the values of each key."""
    if not weights.files:
        yield "has no files"
    paths = [file.path for file in weights.files]
    for twice in sorted({path for path in paths if paths.count(path) > 1}):
        yield f"has the file {_shown(twice)[1:-1]} more than once"
    for file in weights.files:
        if file.source.startswith("http://") and file.sha256 is None:
            yield f"{_shown(file.source)} is not secure: add its sha256, or use https://"
    by_hand = [_shown(file.path)[1:-1] for file in weights.files if not file.source]
    if by_hand and not weights.advice:
        yield f"has no source for {', '.join(by_hand)}: write in 'advice' how to get it"


def _describe(problem: Any) -> str:
    """Return a problem that pydantic found as one line: "files.0.bytes: Input should be greater than 0 (got 0)"."""
    at = ".".join(ascii(str(part))[1:-1] for part in problem["loc"])
    return f"{at}: {problem['msg']} (got {_shown(problem['input'])})".removeprefix(": ")


def _shown(value: Any) -> str:
    """Return a value as one line of ASCII, of at most 80 characters."""
    try:
        text = ascii(value)
    except (ValueError, RecursionError):  # an integer of thousands of digits, or deep tables
        return f"a {type(value).__name__}"
    return text if len(text) <= _MAX_SHOWN else f"{text[: _MAX_SHOWN - 3]}..."
