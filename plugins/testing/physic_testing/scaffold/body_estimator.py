"""Bodies independent of the photo: everybody stands upright, faces the camera and has the same
height.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core.interfaces import BodyEstimator, Options
from physic_core.types import Bodies, BodyParameters

if TYPE_CHECKING:
    from physic_core.types import Hints, Intrinsics, Keypoints, People, UInt8Array

_COMPONENTS = 16  # shape components of the body model "embedded"


class TemplateOptions(Options):
    """Settings of Template."""

    stature_m: float = Field(1.7, gt=0.3, lt=2.5, description="height of every person, m")


class Template(BodyEstimator):
    """Places the embedded body in rest pose at each person's box."""

    written_for = 1
    Options = TemplateOptions
    options: TemplateOptions
    # remove it once infer() looks at the image
    capabilities = ("ignores_image",)

    def infer(
        self,
        image: UInt8Array,
        people: People,
        intrinsics: Intrinsics,
        keypoints: Keypoints,
        hints: Hints,
    ) -> Bodies:
        """N people -> N bodies in metres in the camera frame (x right, y down, z forward)."""
        count = len(people)
        x0, y0, x1, y1 = people.boxes.astype(np.float64).T
        z = intrinsics.fy * self.options.stature_m / np.maximum(y1 - y0, 1)
        x = ((x0 + x1) / 2 - 0.5 - intrinsics.cx) / intrinsics.fx * z
        y = ((y0 + y1) / 2 - 0.5 - intrinsics.cy) / intrinsics.fy * z

        def zeros(width: int) -> np.ndarray:
            return np.zeros((count, width), np.float32)

        upright = zeros(3)
        upright[:, 0] = np.pi  # 180 degrees about x: y of the body points up, y of the camera down
        parameters = BodyParameters(
            global_orient=upright,
            body_pose=zeros(63),
            left_hand_pose=zeros(45),
            right_hand_pose=zeros(45),
            jaw_pose=zeros(3),
            leye_pose=zeros(3),
            reye_pose=zeros(3),
            betas=zeros(_COMPONENTS),
            expression=zeros(0),
            transl=np.stack([x, y, z], axis=1).astype(np.float32),
        )
        return Bodies(parameters, "embedded")
