"""Metric depth: the relative point map, scaled to the distance of the estimated bodies."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth, Options
from physic_core.types import DepthMap

if TYPE_CHECKING:
    from physic_core.types import Hints, UInt8Array


class TemplateOptions(Options):
    """Settings of Template."""

    scale_sigma: float = Field(
        0.3, gt=0, lt=3, description="standard deviation of log(scale); 0.1-0.5"
    )


class Template(MetricDepth):
    """Scales the relative point map to the distance of the estimated bodies."""

    written_for = 1
    Options = TemplateOptions
    options: TemplateOptions

    def load(self, device: str = "cpu") -> None:
        """Load weights onto ``device`` here; do nothing if they are loaded.

        Constructors are fast and offline.
        """

    def close(self) -> None:
        """Release the weights here; ``load`` and ``close`` may be called twice."""

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Image (H, W, 3) -> z-depth (H, W) in metres, NaN where unknown."""
        scene = hints.scene
        original = hints.original
        people = hints.people
        bodies = hints.bodies
        if scene is None or original is None or people is None or bodies is None or not len(people):
            raise BackendError(
                "this depth needs hints.scene, hints.original, hints.people and hints.bodies"
            )
        depths = [original.points[mask & original.valid, 2] for mask in people.masks]
        # The root joint is about as far away as the visible surface of the body.
        ratios = [
            z / np.median(depths_of_person)
            for z, depths_of_person in zip(bodies.parameters.transl[:, 2], depths, strict=True)
            if len(depths_of_person)
        ]
        if not ratios:
            raise BackendError("no person has a depth in hints.original")
        depth = np.where(scene.valid, scene.points[..., 2] * np.median(ratios), np.nan).astype(
            np.float32
        )
        return DepthMap(
            depth,
            scene.intrinsics,
            self.options.scale_sigma,
            ("scale from the distance of the bodies",),
        )
