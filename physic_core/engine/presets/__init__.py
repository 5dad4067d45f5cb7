"""Preset "default" of the engine. Plugins add others (hook ``physic_energies``)."""

from __future__ import annotations

from physic_core.engine.presets.default import DefaultOptimisation
from physic_core.engine.settings import EngineSettings, PlacementSettings

__all__ = ["DEFAULT"]

DEFAULT = EngineSettings(placement=PlacementSettings(detect_lifted_feet=True), joint=DefaultOptimisation())
"""Settings of preset "default"."""
