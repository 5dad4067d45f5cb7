"""Presets of the engine by name: the core's "default", and those of plugins (hook ``physic_engine_presets``)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.discovery.catalog import ENGINE_PRESETS
from physic_core.discovery.hooks import PluginItem
from physic_core.discovery.plugins import Found, find_item, find_items, import_item
from physic_core.errors import PluginError

if TYPE_CHECKING:
    from physic_core.engine.settings import EngineSettings

_HOOK = "physic_engine_presets"
DEFAULT_ENERGY = "default"
"""Name of the core's preset."""


def engine_preset_names() -> tuple[str, ...]:
    """Return the names of the core's preset and of those of installed plugins, sorted."""
    return tuple(sorted({DEFAULT_ENERGY, *(preset.record.name for preset in find_items(_HOOK))}))


def check_engine_preset(name: str) -> None:
    """Check that there is one preset of this name, without importing it.

    Raises:
        ConfigError: no preset has this name, or several plugins offer it; the message names the distribution if it
            is known.
    """
    if name != DEFAULT_ENERGY:
        _find(name)


def engine_preset(name: str = DEFAULT_ENERGY) -> EngineSettings:
    """Return the settings of the engine of a preset, such as "default".

    Raises:
        ConfigError: no preset has this name, or several plugins offer it.
        PluginError: the plugin cannot be imported, or names no settings.
    """
    # The terms of stage 3 import torch, which a configuration without engine settings does not need.
    from physic_core.engine.presets import DEFAULT
    from physic_core.engine.settings import EngineSettings

    if name == DEFAULT_ENERGY:
        return DEFAULT
    found = _find(name)
    settings = import_item(found, "engine preset")
    if not isinstance(settings, EngineSettings):
        raise PluginError(f"{found.title('engine preset')} should be an EngineSettings, got {type(settings).__name__}")
    return settings


def _find(name: str) -> Found[PluginItem]:
    return find_item(_HOOK, name, "engine preset", own=DEFAULT_ENERGY, known=ENGINE_PRESETS)
