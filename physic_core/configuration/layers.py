"""Read and merge the layers of a configuration: presets, files, environment variables, ``--set``
and flags.

A layer is a label and a nested dictionary. Later layers override earlier ones. For each value, the
label of its layer is stored: errors and ``physic config show`` use it to name the file, variable or
flag.
"""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from itertools import takewhile
from pathlib import Path
from typing import Any

from physic_core.discovery.error_text import did_you_mean
from physic_core.discovery.local_modules import with_folder
from physic_core.errors import ConfigError
from physic_core.files.atomic import read_text, unreadable
from physic_core.files.text import from_json, parse_json, parse_toml, path_problem, quoted
from physic_core.interfaces import INTERFACES

SettingsLayer = tuple[str, Mapping[str, Any]]
"""One source of settings: its label, and its tables as nested dictionaries."""

PATH_KEYS = (
    ("body_model", "path"),
    ("photo", "depth"),
    ("photo", "pointmap"),
    ("photo", "keypoints"),
    ("photo", "bodies"),
    ("photo", "bodies_model"),
    ("photo", "masks"),
)
"""Table and key of each path of a file; in a config file it is relative to the file."""

_VARIABLE_PREFIX = "PHYSIC__"
_MAX_BYTES = 64 << 20  # as of the document of a result
_PRESETS = resources.files("physic_core.configuration") / "presets"
_ALTERNATIVE_KEYS = {"photo": {"focal_px", "intrinsics"}, "body_model": {"name", "path"}}
"""Alternative keys of a table: a layer that sets one removes the others of earlier layers."""


def preset_names() -> tuple[str, ...]:
    """Return the sorted names of the presets in this package."""
    return tuple(sorted(p.name[:-5] for p in _PRESETS.iterdir() if p.name.endswith(".toml")))


def is_config_path(name: str) -> bool:
    """Return whether a string is a file path rather than the name of a preset."""
    return name.endswith((".toml", ".json")) or "/" in name or os.sep in name


def preset_comment(name: str) -> list[str]:
    """Return the lines, each beginning with "#", that introduce a preset: what is in it, and under
    which licences.
    """
    lines = (_PRESETS / f"{name}.toml").read_text(encoding="utf-8").splitlines()
    return list(takewhile(lambda line: line.startswith("#"), lines))


def preset_layers(name: str) -> list[SettingsLayer]:
    """Return the layers of a preset, preceded by those of the preset that it extends.

    Raises:
        ConfigError: no preset has this name.
    """
    if name not in (names := preset_names()):
        raise ConfigError(
            f"no preset named '{name}'; there are: {', '.join(names)}{did_you_mean(name, names)}"
        )
    table = tomllib.loads((_PRESETS / f"{name}.toml").read_text(encoding="utf-8"))
    base = table.pop("extends", None)
    return [*(preset_layers(base) if base else []), (f"preset {name}", table)]


def file_layers(
    file: str | os.PathLike[str], base: str, above: tuple[Path, ...] = ()
) -> list[SettingsLayer]:
    """Read the layers of a configuration file, preceded by those of the file or preset that it
    extends.

    Args:
        file: a TOML file, or the ``reconstruction.json`` of a run, which extends nothing.
        base: preset that a TOML file without ``extends`` extends.
        above: files that extend this one.

    Raises:
        ConfigError: a file or preset cannot be read.
    """
    path = Path(os.path.expanduser(file))
    real = Path(os.path.realpath(path))  # Path.resolve raises RuntimeError for a link to itself
    if real in above:
        raise ConfigError(f"{path} extends itself")
    is_result = path.suffix == ".json"
    try:
        text = read_text(path, _MAX_BYTES)
        table = from_json(parse_json(text)["config"]) if is_result else parse_toml(text)
        if not isinstance(table, dict):
            raise TypeError("its config is not an object")
    except OSError as error:
        cure = f"; for that preset, write --preset {file}" if str(file) in preset_names() else ""
        raise ConfigError(f"cannot read the config {path}: {unreadable(error)}{cure}") from error
    except KeyError as error:
        raise ConfigError(
            f"{path} is not the reconstruction.json of a run: it has no {error}; name one, or a "
            "TOML file"
        ) from error
    except (ValueError, TypeError) as error:
        kind = "the reconstruction.json of a run" if is_result else "valid TOML"
        is_path_of_windows = "\\" in str(error) or "hex" in str(error)
        cure = r"; write a path with \ in single quotes: 'C:\photos'" if is_path_of_windows else ""
        if isinstance(error, tomllib.TOMLDecodeError) and not cure:
            cure = (
                "; write KEY = VALUE: text in quotes, 1.7 with a point, true or false, lists in []"
            )
        raise ConfigError(f"{path} is not {kind}: {error}{cure}") from error
    _complete_paths(table, path.parent)
    if is_result:
        return [(str(path), table)]
    extended = table.pop("extends", base)
    if not isinstance(extended, str):
        raise ConfigError(
            f"{path}: 'extends' should be a preset name or a path (got {quoted(extended)})"
        )
    try:
        if is_config_path(extended):
            # It builds on the preset "embedded", independently of the preset given for this one.
            below = file_layers(
                path.parent / os.path.expanduser(extended), "embedded", (*above, real)
            )
        else:
            below = preset_layers(extended)
    except ConfigError as error:
        raise ConfigError(f"{path} extends '{extended}': {error}") from error
    return [*below, (str(path), table)]


def environment_layers(environment: Mapping[str, str]) -> list[SettingsLayer]:
    """Return a layer for each environment variable such as ``PHYSIC__INPAINTER__BACKEND=telea``;
    ignore empty ones.

    Raises:
        ConfigError: the name of a variable is not a valid setting.
    """
    names = sorted(
        name
        for name, value in environment.items()
        if name.startswith(_VARIABLE_PREFIX) and value.strip()
    )
    keys = {name: name.removeprefix(_VARIABLE_PREFIX).lower().replace("__", ".") for name in names}
    return [
        (name, _override_table(key, environment[name], f"the variable {name}"))
        for name, key in keys.items()
    ]


def override_layers(overrides: Sequence[str]) -> list[SettingsLayer]:
    """Return a layer for each string "a.b=c" of the option ``--set``; c is TOML, or a string
    without quotes.

    Raises:
        ConfigError: a string does not have the form KEY=VALUE.
    """
    layers: list[SettingsLayer] = []
    for text in overrides:
        key, equals, value = text.partition("=")
        if not equals:
            raise ConfigError(
                f"--set needs KEY=VALUE such as inpainter.backend=telea (got '{text}')"
            )
        table = _override_table(key, value, f"--set {text}")
        _complete_paths(table, Path())
        layers.append(("--set", table))
    return layers


def merge_layers(layers: Iterable[SettingsLayer]) -> tuple[dict[str, Any], dict[str, str]]:
    """Merge layers into one nested dictionary; later layers override earlier ones.

    Returns:
        The merged tables, and a dictionary from dotted path to the label of the layer that set the
        value; the path of a table ends in a dot.
    """
    merged: dict[str, Any] = {}
    sources: dict[str, str] = {}
    for label, table in layers:
        _merge_table(merged, table, label, sources, "")
    return merged, sources


def source_of(sources: Mapping[str, str], path: str, default: str = "default") -> str:
    """Return the label of the layer that set the value or table at a dotted path, or ``default`` if
    none did.
    """
    parts = path.split(".")
    places = [
        path,
        f"{path}.",
        *(".".join(parts[:count]) for count in range(len(parts) - 1, 0, -1)),
    ]
    return next((sources[place] for place in places if place in sources), default)


def _merge_table(
    base: dict[str, Any],
    layer: Mapping[str, Any],
    label: str,
    sources: dict[str, str],
    table: str,
) -> None:
    """Merge a layer into ``base`` in place, and store the label of the layer for each value."""
    if table in INTERFACES and not _same_backend(layer.get("backend"), base.get("backend")):
        base.pop("options", None)
        for path in [path for path in sources if path.startswith(f"{table}.options.")]:
            del sources[path]
    alternatives = _ALTERNATIVE_KEYS.get(table, set())
    for key in alternatives if alternatives & layer.keys() else ():
        base.pop(key, None)
    for key, value in layer.items():
        path = f"{table}.{key}" if table else key
        if isinstance(value, Mapping):
            if not isinstance(base.get(key), dict):
                base[key] = {}
            _merge_table(base[key], value, label, sources, path)
            sources[f"{path}."] = label
        else:
            base[key] = value
            sources[path] = label


def _same_backend(name: Any, before: Any) -> bool:
    """Return whether a layer keeps the backend: it names none, or the same one, with or without its
    distribution.
    """
    if name is None or name == before:
        return True
    owner, _, bare = str(name).rpartition(":")
    owner_before, _, bare_before = str(before).rpartition(":")
    return bare == bare_before and not (owner and owner_before)


def _override_table(key: str, value: str, title: str) -> dict[str, Any]:
    """Return the nested tables of one value at a dotted path; the value is TOML, or a string
    without quotes.
    """
    try:
        return parse_toml(f"{key} = {value}")
    except ValueError:
        text = json.dumps(value.strip(), ensure_ascii=False)
    try:
        return parse_toml(f"{key} = {text}")
    except ValueError as error:
        raise ConfigError(
            f"{title}: '{key}' does not name a setting, such as inpainter.backend ({error})"
        ) from error


def _complete_paths(table: dict[str, Any], folder: Path) -> None:
    """Add a folder to the names of classes in local files, and to paths, so that they are found
    from anywhere.
    """
    for name in INTERFACES:
        own = table.get(name)
        if isinstance(own, dict) and isinstance(own.get("backend"), str):
            own["backend"] = with_folder(own["backend"], folder)
    for name, key in PATH_KEYS:
        own = table.get(name)
        # A text that cannot be a path is refused by the model.
        if isinstance(own, dict) and isinstance(own.get(key), str) and not path_problem(own[key]):
            own[key] = str(folder / os.path.expanduser(own[key]))
