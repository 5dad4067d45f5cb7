"""Relative point map independent of the photo: a floor that ends at a wall."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core.interfaces import Options, RelativePointmap
from physic_core.types import CameraTrust, Intrinsics, Pointmap

if TYPE_CHECKING:
    from physic_core.types import Hints, UInt8Array


class TemplateOptions(Options):
    """Settings of Template."""

    wall: float = Field(
        3.0, gt=1, description="distance of the wall, in camera heights; 2-10 works"
    )


class Template(RelativePointmap):
    """Returns a level floor one unit below the camera, and a wall, for every photo."""

    written_for = 1
    Options = TemplateOptions
    options: TemplateOptions
    # remove it once infer() looks at the image
    capabilities = ("ignores_image",)

    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Image (H, W, 3) -> points (H, W, 3): x right, y down, z forward, up to a scale."""
        height, width = image.shape[:2]
        camera = hints.intrinsics or Intrinsics.from_focal(
            1.2 * max(height, width), width, height, "default: 1.2 sides", CameraTrust.GUESSED
        )
        v, u = np.mgrid[:height, :width]  # integer pixel coordinates are pixel centres
        x = (u - camera.cx) / camera.fx
        y = (v - camera.cy) / camera.fy
        z = 1 / np.maximum(y, 1 / self.options.wall)  # the floor is y z = 1
        points = np.stack([x * z, y * z, z], axis=-1).astype(np.float32)
        return Pointmap(
            points,
            np.ones((height, width), bool),
            "scale",
            camera,
            ("a floor and a wall, for every photo",),
        )
