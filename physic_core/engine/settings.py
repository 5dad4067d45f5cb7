"""Settings of the engine: frozen dataclasses, one per stage.

The documentation of a field gives its meaning, its useful values, and the value that switches it off. The type of a
stage's settings selects what the stage does; the energy of a plugin has subclasses of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, is_dataclass, replace
from typing import Any, Literal, TypeVar

from physic_core.engine.bounds import NotNegative, Share
from physic_core.engine.joint.settings import JointSettings
from physic_core.engine.placement.settings import PlacementSettings
from physic_core.engine.scene.settings import SceneSettings

__all__ = [
    "ContactSettings",
    "EngineSettings",
    "JointSettings",
    "PlacementSettings",
    "SceneSettings",
    "with_overrides",
]


@dataclass(frozen=True)
class ContactSettings:
    """Settings of the contact map.

    Attributes:
        rule: "probability" gives contact to vertices whose probability of contact is at least the threshold, "distance"
            to those whose distance is within the two bounds; it estimates no probability.
        threshold: least probability of a vertex in contact. 0.35 has the best F1 on worlds that took no part in the
            fit, of limbs that the photo shows, and of those that it does not show.
        skin_threshold: the same for contact with other people and with the own body, which is less certain. 0.16 has
            an F1 of .21 there, and 0.12 one of .22, with half more vertices on body parts that touch no skin.
        distance_m: largest distance to scene or floor of a vertex in contact, metres; 0.02 as released. The probability
            is that of a true distance within the bounds.
        inside_m: largest depth inside of a vertex in contact, metres; 0.15 as released. 0.05 is the usual compression
            of soft tissue and cushions.
        metric: "plane" measures along the normal of the surface, "point" to the nearest point.
        people: contact with other people and with the own body too.
        objects: small objects in hands and on laps are no part of the scene, and people touch them
            (:mod:`physic_core.engine.contact.objects`).
        assume_supports: people whom nothing in the scene carries touch a hidden support, such as a seat or what their
            hands hold (:mod:`physic_core.engine.contact.support`).
    """

    rule: Literal["probability", "distance"] = "probability"
    threshold: Share = 0.35
    skin_threshold: Share = 0.16
    distance_m: NotNegative = 0.02
    inside_m: NotNegative = 0.05
    metric: Literal["plane", "point"] = "plane"
    people: bool = True
    objects: bool = True
    assume_supports: bool = True


@dataclass(frozen=True, kw_only=True)
class EngineSettings:
    """Settings of the engine, one object per stage; the type of ``joint`` selects the energy of stage 3."""

    scene: SceneSettings = field(default_factory=SceneSettings)
    placement: PlacementSettings = field(default_factory=PlacementSettings)
    joint: JointSettings
    contact: ContactSettings = field(default_factory=ContactSettings)


_Settings = TypeVar("_Settings")


def with_overrides(settings: _Settings, overrides: Mapping[str, Any]) -> _Settings:
    """Return a copy of a dataclass with replaced fields; nested dataclasses are given as mappings of their fields."""
    changed = {
        name: with_overrides(getattr(settings, name), value) if is_dataclass(getattr(settings, name)) else value
        for name, value in overrides.items()
    }
    return replace(settings, **changed)  # type: ignore[type-var]
