"""Settings of stage 1: scale, camera and floor of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from physic_core.engine.bounds import NotNegative, PositiveOrInfinite

__all__ = ["SceneSettings"]


@dataclass(frozen=True)
class SceneSettings:
    """Settings of stage 1: metric scene points, camera, normals, floor (paper Sec. 3.1)."""

    far_m: PositiveOrInfinite = 50.0
    """Points beyond are removed, metres."""
    floor: Literal["disparity", "off"] = "disparity"
    """"disparity" fits a plane in inverse depth. "off" finds no floor."""
    floor_under_people: bool = True
    """If no floor is found, fit one under the soles of people who stand or sit upright."""
    carve_m: NotNegative = 0.5
    """Largest distance by which inpainted scene points are moved behind a body that contains or should occlude them,
    metres; 0 moves none."""
