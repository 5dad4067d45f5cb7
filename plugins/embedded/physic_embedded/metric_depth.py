"""Metric depth of a scene by the size of its people: the relative depth at the scale that the hints
state.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth
from physic_core.types import DepthMap

if TYPE_CHECKING:
    from physic_core.types import Hints, UInt8Array


class EmbeddedMetricDepth(MetricDepth):
    """Metric depth: the relative depth of the scene, scaled by the known size of the people.

    The pipeline finds this scale, see :mod:`physic_core.engine.sizes.scale_vote`.
    """

    written_for = 1
    reads = ("intrinsics", "scene", "scale")

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Return the depth (H, W) of ``hints.scene`` in metres.

        Raises:
            BackendError: hints lack the scene or its scale.
        """
        from physic_core.engine.sizes.scale_vote import scaled_depth

        if hints.scene is None or hints.scale is None:
            missing = "scene" if hints.scene is None else "scale"
            raise BackendError(
                f"the embedded metric depth needs hints.scene and hints.scale, and hints.{missing} "
                "is missing: use it in the pipeline, which finds both before it, or choose a "
                "metric depth network"
            )
        return scaled_depth(hints.scene, hints.scale, hints.intrinsics)
