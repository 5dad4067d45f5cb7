"""Scene of a photo without its people. OpenCV camera frame, metres."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from torch import Tensor

from physic_core.engine.up import Up, up_of_camera_axis
from physic_core.geometry.floor import PlaneFit
from physic_core.geometry.pixels import select_pixels
from physic_core.types.short_repr import ShortRepr


@dataclass(frozen=True)
class SceneState(ShortRepr):
    """The scene without people, metres, camera frame.

    Attributes:
        points: (H, W, 3); every valid point projects to its pixel (not in preset "paper").
        normals: (H, W, 3) unit, facing the camera; zero where unknown.
        valid: (H, W) bool; False at depth edges, outliers and beyond the far limit.
        floor_points: (M, 3) on the floor, within the extent of the scene.
        K: (3, 3) px, float64.
        floor: fitted floor plane, or None.
        up: against gravity, whether or not there is a floor.
        diagnostics: of the stage, by topic.
    """

    points: Tensor
    normals: Tensor
    valid: Tensor
    floor_points: Tensor
    K: Tensor
    floor: PlaneFit | None = None
    up: Up = field(default_factory=up_of_camera_axis)
    diagnostics: Mapping[str, Any] = field(default_factory=dict)

    @property
    def surface(self) -> tuple[Tensor, Tensor]:
        """Points and normals (M, 3) of the valid pixels."""
        points, normals = select_pixels(self.valid, self.points, self.normals)
        return points, normals

    @property
    def depth(self) -> Tensor:
        """Depth map (H, W) along z, metres; NaN at invalid pixels."""
        return torch.where(self.valid, self.points[..., 2], torch.nan)


@dataclass(frozen=True)
class Surroundings(ShortRepr):
    """Surfaces around people, metres, in the type of their bodies.

    Attributes:
        points: (M, 3), valid points of the scene.
        normals: (M, 3) unit towards the camera, zero where unreliable.
        floor: None if there is no plane of the floor.
        floor_points: (F, 3) samples of the plane.
        depth: (H, W) metres along z of the points, NaN where unknown; None if nothing shows which
            space is free.
    """

    points: Tensor
    normals: Tensor
    floor: PlaneFit | None
    floor_points: Tensor
    depth: Tensor | None

    @classmethod
    def of(cls, scene: SceneState, like: Tensor) -> Surroundings:
        """Return the surfaces of a scene, in the type of ``like``."""
        points, normals = scene.surface
        floor = scene.floor
        return cls(
            points=points.to(like),
            normals=normals.to(like),
            floor=floor and replace(floor, normal=floor.normal.to(like)),
            floor_points=scene.floor_points.to(like),
            depth=scene.depth.to(like),
        )
