"""Read and merge the layers of a configuration: presets, environment variables, ``--set`` and flags.

A layer is a label and a nested dictionary. Later layers override earlier ones. For each value, the label of its layer
is stored: errors and ``physic config show`` use it to name the file, variable or flag.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from physic_core.configuration.quoting import printable, shorten
from physic_core.configuration.values import InvalidTextError, check_values, parse_toml
from physic_core.discovery.local_modules import with_folder
from physic_core.discovery.offers import canonicalize_name
from physic_core.errors import ConfigError
from physic_core.interfaces import INTERFACES

SettingsLayer = tuple[str, Mapping[str, Any]]
"""One source of settings: its label, and its tables as nested dictionaries."""

_VARIABLE_PREFIX = "PHYSIC__"
YAML_SUFFIXES = (".yaml", ".yml")
_ALTERNATIVE_KEYS = (("photo", ("focal_px", "intrinsics")), ("body_model", ("name", "path")))
"""Alternative keys of a table: a layer that sets one removes the others of earlier layers."""


def preset_names() -> tuple[str, ...]:
    """Return the sorted names of the presets in this package."""
    return tuple(sorted(p.name[:-5] for p in _presets().iterdir() if p.name.endswith(".toml")))


def is_path(name: str) -> bool:
    """Return whether a string is a file path rather than the name of a preset."""
    return name.endswith((".toml", ".json", *YAML_SUFFIXES)) or "/" in name or os.sep in name


def environment_layers(environment: Mapping[str, str]) -> list[SettingsLayer]:
    """Return a layer for each environment variable such as ``PHYSIC__INPAINTER__BACKEND=telea``; ignore empty ones.

    Raises:
        ConfigError: the name of a variable is not a valid setting.
    """
    layers: list[SettingsLayer] = []
    for name in sorted(n for n, value in environment.items() if n.startswith(_VARIABLE_PREFIX) and value.strip()):
        path = name.removeprefix(_VARIABLE_PREFIX).lower().replace("__", ".")
        if not re.fullmatch(r"[a-z0-9]\w*(\.[a-z0-9]\w*)*", path, re.ASCII):
            raise ConfigError(
                f"the variable {shown(name)} does not name a setting: write PHYSIC__INPAINTER__BACKEND=telea"
            )
        value = environment[name]
        layers.append((name, _assignment(path, value, f"the variable {shown(name)}={shown(value)}")))
    return layers


def override_layers(overrides: Sequence[str]) -> list[SettingsLayer]:
    """Return a layer for each string "a.b=c" of the option ``--set``; c is TOML, or a string without quotes.

    Raises:
        ConfigError: a string does not have the form KEY=VALUE.
    """
    return [("--set", add_folder(_parse_override(text), Path())) for text in overrides]


def merge_layers(layers: Iterable[SettingsLayer]) -> tuple[dict[str, Any], dict[str, str]]:
    """Merge layers into one nested dictionary; later layers override earlier ones.

    Returns:
        The merged tables, and a dictionary from dotted path to the label of the layer that set the value.

    Raises:
        ConfigError: a layer has values that are too large, or of a type that TOML does not have.
    """
    merged: dict[str, Any] = {}
    sources: dict[str, str] = {}
    for label, table in layers:
        if problems := check_values(table):
            from physic_core.configuration.problem_text import config_error

            raise config_error(problems, lambda _, label=label: label, label)  # type: ignore[misc]
        _merge(merged, table, label, sources)
    return merged, sources


def source_of(sources: Mapping[str, str], path: str) -> str:
    """Return the label of the layer that set the value or table at a dotted path, or "default" if none did."""
    if f"{path}." in sources:
        return sources[f"{path}."]
    while path:
        if path in sources:
            return sources[path]
        path = path.rpartition(".")[0]
    return "default"


def _presets() -> Any:
    return resources.files("physic_core.configuration") / "presets"


def preset_layers(name: str) -> list[SettingsLayer]:
    """Return the layers of a preset, preceded by those of the preset that it extends.

    Raises:
        ConfigError: no preset has this name.
    """
    if name not in preset_names():
        from physic_core.discovery.close_names import did_you_mean

        names = preset_names()
        raise ConfigError(f"no preset named '{shown(name)}'; there are: {', '.join(names)}{did_you_mean(name, names)}")
    table = parse_toml((_presets() / f"{name}.toml").read_text(encoding="utf-8"))
    base = table.pop("extends", None)
    return [*(preset_layers(base) if base else []), (f"preset {name}", table)]


def add_folder(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Add the config's folder to the names of classes in local files, so that they are found from any working
    folder."""
    for choice in (table.get(interface) for interface in INTERFACES):
        if isinstance(choice, dict) and isinstance(choice.get("backend"), str):
            choice["backend"] = with_folder(choice["backend"], folder)
    return table


def _parse_override(text: str) -> dict[str, Any]:
    key, equals, value = text.partition("=")
    if not equals or not re.fullmatch(r"\s*[\w-]+(\.[\w-]+)*\s*", key, re.ASCII):
        raise ConfigError(f"--set needs KEY=VALUE such as inpainter.backend=telea (got '{shown(text)}')")
    return _assignment(key.strip(), value, f"--set {shown(text)}")


def _assignment(path: str, value: str, label: str) -> dict[str, Any]:
    """Return the nested tables of one value at a dotted path; the value is TOML, or a string without quotes."""
    try:
        parsed = parse_toml(f"value = {value}")
    except InvalidTextError as error:
        if not re.fullmatch(r"[\w./~:+-]+", value.strip()):
            message = f"the value is not valid TOML ({shown(error, 500)})"
            raise ConfigError(f"{label}: {message}; strings need quotes") from error
        parsed = {"value": value.strip()}
    if list(parsed) != ["value"]:
        raise ConfigError(f"{label}: expected one value without a line break")
    table = parsed["value"]
    for key in reversed(path.split(".")):
        table = {key: table}
    return dict(table)


def shown(text: object, limit: int = 200) -> str:
    """Return a user's text for a message."""
    return printable(shorten(str(text), limit))


def _merge(base: dict[str, Any], layer: Mapping[str, Any], label: str, sources: dict[str, str], at: str = "") -> None:
    """Merge a layer into ``base`` in place, and store the label of the layer for each value."""
    for key, value in layer.items():
        path = f"{at}{key}"
        below = base.get(key)
        if isinstance(value, Mapping):
            if not isinstance(below, dict):
                below = base[key] = {}
            _remove_overridden(path, below, value)
            _merge(below, value, label, sources, f"{path}.")
            sources[f"{path}."] = label  # the final dot marks a table
        else:
            base[key] = value
            for covered in [p for p in sources if p.startswith(f"{path}.")]:
                del sources[covered]
            sources[path] = label


def _same_backend(one: Any, other: Any) -> bool:
    """Return whether two names can mean the same backend, such as "embedded" and "physic-embedded:embedded"."""
    if not (isinstance(one, str) and isinstance(other, str)):
        return bool(one == other)
    (owner, colon, name), (other_owner, other_colon, other_name) = one.rpartition(":"), other.rpartition(":")
    return name == other_name and (
        not (colon and other_colon) or canonicalize_name(owner) == canonicalize_name(other_owner)
    )


def _remove_overridden(path: str, below: dict[str, Any], layer: Mapping[str, Any]) -> None:
    """Remove values that a layer makes invalid: options of the previous backend, and alternatives of a set key."""
    if path in INTERFACES and "backend" in layer and not _same_backend(layer["backend"], below.get("backend")):
        below.pop("options", None)
    for table, keys in _ALTERNATIVE_KEYS:
        if path == table and any(k in layer for k in keys):
            for key in keys:
                below.pop(key, None)
