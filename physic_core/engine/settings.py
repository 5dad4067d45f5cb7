"""Settings of the engine: frozen dataclasses, one per stage.

The documentation of a field gives its meaning, its useful values, and the value that disables it.
The type of a stage's settings selects what the stage does; a plugin's energy has its own
subclasses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from physic_core.engine.contact.method import ContactStageMethod
    from physic_core.engine.joint.method import JointStageMethod
    from physic_core.engine.placement.method import PlacementStageMethod
    from physic_core.engine.scene.method import SceneStageMethod


@dataclass(frozen=True)
class EngineSettings:
    """Settings of the engine, one object per stage, whose type selects what the stage does."""

    scene: SceneStageMethod
    placement: PlacementStageMethod
    joint: JointStageMethod
    contact: ContactStageMethod


_Settings = TypeVar("_Settings")


def with_overrides(settings: _Settings, overrides: Mapping[str, Any]) -> _Settings:
    """Return a copy of a dataclass with replaced fields; nested dataclasses are given as mappings
    of their fields.
    """
    changed = {
        name: with_overrides(getattr(settings, name), value)
        if is_dataclass(getattr(settings, name))
        else value
        for name, value in overrides.items()
    }
    return replace(settings, **changed)  # type: ignore[type-var]
