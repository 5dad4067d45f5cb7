"""Preset "default" of the engine. Plugins add others (hook ``physic_engine_presets``)."""

from __future__ import annotations

from physic_core.engine.contact.method import ContactMethod
from physic_core.engine.placement.method import PlacementMethod
from physic_core.engine.presets.default import DefaultOptimisation
from physic_core.engine.scene.method import SceneMethod
from physic_core.engine.settings import EngineSettings

__all__ = ["DEFAULT"]

DEFAULT = EngineSettings(SceneMethod(), PlacementMethod(), DefaultOptimisation(), ContactMethod())
"""Settings of preset "default"."""
