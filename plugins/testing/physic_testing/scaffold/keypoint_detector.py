"""Keypoints independent of the photo: a standing person on the vertical centre line of each box."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core.interfaces import KeypointDetector, Options
from physic_core.types import Keypoints

if TYPE_CHECKING:
    from physic_core.types import People, UInt8Array

_HEIGHTS = {
    "nose": 0.07, "left_eye": 0.06, "right_eye": 0.06, "left_ear": 0.07, "right_ear": 0.07,
    "left_shoulder": 0.19, "right_shoulder": 0.19, "left_elbow": 0.35, "right_elbow": 0.35,
    "left_wrist": 0.49, "right_wrist": 0.49, "left_hip": 0.5, "right_hip": 0.5, "left_knee": 0.73,
    "right_knee": 0.73, "left_ankle": 0.94, "right_ankle": 0.94,
}  # fmt: skip
"""Height of each joint of the skeleton "coco17" in a standing person's box: 0 is the top, 1 the
bottom.
"""


class TemplateOptions(Options):
    """Settings of Template."""

    confidence: float = Field(0.3, ge=0, le=1, description="confidence of every joint")


class Template(KeypointDetector):
    """Places the joints of a standing person on the vertical centre line of each box."""

    written_for = 1
    Options = TemplateOptions
    options: TemplateOptions
    # remove it once infer() looks at the image
    capabilities = ("ignores_image",)

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Image (H, W, 3) and N people -> points (N, 17, 2) in px of the photo, row i for person
        i.
        """
        figure = np.array([(0.5, height) for height in _HEIGHTS.values()])
        low = people.boxes[:, None, :2]
        high = people.boxes[:, None, 2:]
        # box edges are pixel borders, integer points are pixel centres
        points = low + figure * (high - low) - 0.5
        return Keypoints(points, np.full(points.shape[:2], self.options.confidence), "coco17")
