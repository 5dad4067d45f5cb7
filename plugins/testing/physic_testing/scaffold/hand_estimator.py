"""Hand poses independent of the photo: no hand is detected."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core.interfaces import HandEstimator, Options
from physic_core.types import Hands

if TYPE_CHECKING:
    from physic_core.types import Keypoints, People, UInt8Array


class TemplateOptions(Options):
    """Settings of Template."""

    min_confidence: float = Field(
        0.5, ge=0, le=1, description="hands of lower confidence are dropped; 0.3-0.7 works"
    )


class Template(HandEstimator):
    """Returns confidence 0 for all hands, so that fingers stay in rest pose."""

    written_for = 1
    Options = TemplateOptions
    options: TemplateOptions

    def infer(self, image: UInt8Array, people: People, keypoints: Keypoints) -> Hands:
        """N people -> rotation vectors (N, 2, 15, 3) in radians, left hand first, and confidence
        (N, 2).
        """
        count = len(people)
        return Hands(np.zeros((count, 2, 15, 3), np.float32), np.zeros((count, 2), np.float32))
