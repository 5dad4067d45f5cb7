"""Person masks as ellipses in boxes that the user gives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from physic_core.interfaces import Options, Segmenter
from physic_core.types import People

if TYPE_CHECKING:
    from physic_core.types import UInt8Array


class TemplateOptions(Options):
    """Settings of Template."""

    boxes: tuple[tuple[float, float, float, float], ...] = Field(
        (), description="x0 y0 x1 y1 of each person, px of the photo"
    )


class Template(Segmenter):
    """Returns the ellipse in each given box as a person; an earlier box occludes a later one."""

    written_for = 1
    Options = TemplateOptions
    options: TemplateOptions

    @staticmethod
    def conformance_options(world: Any) -> Mapping[str, Any]:
        """Return the options that the conformance kit uses for a synthetic world, instead of the
        defaults.
        """
        return {"boxes": world.boxes.tolist()}

    def infer(self, image: UInt8Array) -> People:
        """Image (H, W, 3) -> N people with masks (N, H, W), boxes x0 y0 x1 y1 in px and scores in
        [0, 1].
        """
        height, width = image.shape[:2]
        v, u = np.mgrid[:height, :width]
        free = np.ones((height, width), bool)
        masks = []
        boxes = []
        for x0, y0, x1, y1 in self.options.boxes:
            across = (2 * u + 1 - x0 - x1) / max(x1 - x0, 1)
            down = (2 * v + 1 - y0 - y1) / max(y1 - y0, 1)
            mask = (across**2 + down**2 < 1) & free
            if mask.any():  # each mask has at least one pixel, and masks do not overlap
                free &= ~mask
                rows = np.flatnonzero(mask.any(axis=1))
                columns = np.flatnonzero(mask.any(axis=0))
                masks.append(mask)
                boxes.append([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])
        count = len(masks)
        return People(
            masks=np.array(masks, bool).reshape(count, height, width),
            boxes=np.array(boxes, np.float32).reshape(count, 4),
            scores=np.full(count, 0.5, np.float32),
        )
