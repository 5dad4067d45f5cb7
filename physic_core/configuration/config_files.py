"""Read configuration files: TOML, and the configuration in ``reconstruction.json`` of a run."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path
from typing import Any

from physic_core.configuration.layers import (
    YAML_SUFFIXES,
    SettingsLayer,
    add_folder,
    is_path,
    preset_layers,
    shown,
)
from physic_core.configuration.quoting import quoted, shorten
from physic_core.configuration.values import InvalidTextError, check_values, parse_toml
from physic_core.errors import ConfigError
from physic_core.files.strict_json import from_json, parse_json

_PATHS = (("body_model", "path"), ("photo", "masks"), ("photo", "depth"), ("photo", "pointmap"))
"""Table and key of the paths that are relative to their config file."""

_MAX_BYTES = {".toml": 1_000_000, ".json": 100_000_000}
"""Maximum size of a config file, bytes. A file with every setting has 40,000, a result with 40 people 200,000."""

_YAML_LINE = re.compile(r"(?:\s*(?:#[^\n]*)?\n)*(?:---|[\w-]+:(?:\s|$))")
"""Matches text whose first line, ignoring comments, is YAML."""

_MAX_EXTENDS = 16
"""Maximum number of files that extend each other."""


def read_layers(file: str | os.PathLike[str], base: str) -> list[SettingsLayer]:
    """Read the layers of a configuration file and of the files that it extends.

    Args:
        file: a TOML file, or the ``reconstruction.json`` of a run, which extends nothing.
        base: preset that a TOML file without ``extends`` extends.

    Raises:
        ConfigError: a file or preset cannot be read.
    """
    return _read_file(_path(os.fspath(file)), base)


def _read_file(path: Path, base: str, seen: tuple[str, ...] = ()) -> list[SettingsLayer]:
    """Read the layers of a file, preceded by those of the file that it extends."""
    seen = (*seen, os.path.realpath(path))
    if seen[-1] in seen[:-1]:
        raise ConfigError(f"{shown(path)} extends itself: {shown(' -> '.join(seen), 1000)}")
    if len(seen) > _MAX_EXTENDS:
        raise ConfigError(f"more than {_MAX_EXTENDS} files extend each other; the last is {shown(path)}")
    if path.suffix == ".json":
        return [(str(path), add_folder(_read_result(path), path.parent))]
    table = add_folder(_read_toml(path), path.parent)
    base = table.pop("extends", base)
    if not isinstance(base, str):
        raise ConfigError(
            f"{shown(path)}: 1 error\nextends   should be the name of a preset or a path (got {quoted(base)})"
        )
    for name, key in _PATHS:
        own = table.get(name)
        if isinstance(own, dict) and isinstance(own.get(key), str):
            own[key] = str(path.parent / _path(own[key], f"{shown(path)}: {name}.{key}"))
    if not is_path(base):
        try:
            return [*preset_layers(base), (str(path), table)]
        except ConfigError as error:
            raise ConfigError(f"{shown(path)} extends '{shown(base)}': {error}") from error
    extended = path.parent / _path(base, f"{shown(path)}: extends")
    try:
        # An extended file builds on the preset "embedded", independently of the preset given for this one.
        return [*_read_file(extended, "embedded", seen), (str(path), table)]
    except ConfigError as error:
        message = f"{shown(path)} extends '{shown(base)}': {error}"
        raise ConfigError(shorten(message, 3000)) from error


def _read_toml(path: Path) -> dict[str, Any]:
    text = _read_text(path, "name a TOML file")
    try:
        return parse_toml(text)
    except InvalidTextError as error:
        if path.suffix in YAML_SUFFIXES or _YAML_LINE.match(text):
            raise ConfigError(
                f"{shown(path)} is YAML, but TOML is needed: write [inpainter] on a line, and "
                'backend = "telea" below it'
            ) from error
        raise ConfigError(f"{shown(path)} is not valid TOML: {shown(error, 500)}") from error


def _read_result(path: Path) -> dict[str, Any]:
    """Read the configuration that is stored in a ``reconstruction.json``."""
    try:
        document = parse_json(_read_text(path, "name the reconstruction.json of a run"))
    except ValueError as error:
        raise ConfigError(f"{shown(path)} is not valid JSON: {shown(error, 500)}") from error
    table = document.get("config") if isinstance(document, dict) else None
    if not isinstance(table, dict) or not table:
        raise ConfigError(
            f"{shown(path)} contains no configuration: name the reconstruction.json of a run, or a TOML file"
        )
    if problems := check_values(table):  # from_json is recursive
        from physic_core.configuration.problem_text import config_error

        raise config_error(problems, lambda _: str(path), str(path))
    numbers: dict[str, Any] = from_json(table)
    return numbers


def _read_text(path: Path, advice: str) -> str:
    title = f"cannot read the config {shown(path)}"
    limit = _MAX_BYTES.get(path.suffix, _MAX_BYTES[".toml"])
    try:
        status = path.stat()
        if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):  # reading a pipe would block
            raise ConfigError(f"{title}: it is not a regular file; {advice}")
        if status.st_size > limit and stat.S_ISREG(status.st_mode):
            raise ConfigError(f"{title}: it has {status.st_size:,} bytes, more than {limit:,}; {advice}")
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise ConfigError(f"no config file at {shown(path)}: check the path") from None
    except OSError as error:
        raise ConfigError(f"{title}: {error.strerror}; {advice}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{title}: {error}; save it as UTF-8") from error


def _path(text: str, title: str = "config") -> Path:
    """Return the path that a text names, with ``~`` expanded; ``~name`` is kept if it has no home folder.

    Raises:
        ConfigError: the text has a null character.
    """
    if "\0" in text:
        raise ConfigError(f"{title}: a path must not contain null characters (got {quoted(text)})")
    return Path(os.path.expanduser(text))  # unlike Path.expanduser, it never raises
