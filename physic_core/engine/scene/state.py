"""Scene of a photo without its people. OpenCV camera frame, metres."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from physic_core.geometry.alignment import Alignment
from physic_core.geometry.floor import PlaneFit
from physic_core.geometry.tensors import select_pixels
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
        alignment: of the relative point map to the metric depth.
        floor: fitted floor plane, or None.
        diagnostics: of the stage, by topic.
    """

    points: Tensor
    normals: Tensor
    valid: Tensor
    floor_points: Tensor
    K: Tensor
    alignment: Alignment
    floor: PlaneFit | None = None
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

    @property
    def floor_plane(self) -> tuple[Tensor, float] | None:
        """Normal and offset of the floor, or None."""
        return None if self.floor is None else (self.floor.normal, self.floor.offset)
