"""Interface MetricDepth: depth map in metres."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from physic_core.interfaces.backend import Backend, Request
from physic_core.interfaces.checks import check_array, check_camera, check_median, check_notes, check_sigma, is_finite
from physic_core.interfaces.limits import DEPTH_M
from physic_core.types import DepthMap, Hints

if TYPE_CHECKING:
    from physic_core.types import UInt8Array


@dataclass(frozen=True)
class MetricDepthRequest(Request[DepthMap]):
    """Input of a MetricDepth: the inpainted photo and hints.

    ``people``, ``keypoints`` and ``bodies`` of the hints are limited to people with a finite body.
    """

    hints: Hints = field(default_factory=Hints)


class MetricDepth(Backend):
    """Estimates a metric depth map of the inpainted photo (paper: DepthPro).

    A depth has a scale of its own, and counts beside the people and all else of known size: by its ``scale_sigma``, or
    0.1 without one. The depth is multiplied so that it has the scale of all. A backend whose ``reads`` names "scale"
    gets in ``hints.scale`` what the others say, and its depth is used as it is. A backend that needs people, and gets
    none, raises NoPersonError: the depth is then that of the scene.
    """

    interface = "metric_depth"
    api = 1
    Request = MetricDepthRequest
    Result = DepthMap
    sees = "inpainted"
    hints = ("intrinsics", "people", "keypoints", "hole", "scene", "original", "floor", "scale", "bodies")

    @abstractmethod
    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Estimate the depth of each pixel along z, in metres; NaN where unknown.

        A network for a fixed focal length f sees a photo of another one, fx, at a wrong distance: multiply by fx / f.

        Example: a wall straight ahead at 3 m has the depth 3.0 in all pixels, in the corners too.
        """

    @classmethod
    def check(cls, result: DepthMap, request: MetricDepthRequest) -> Iterator[str]:
        """Check depth (H, W), within limits or NaN, with at least one known pixel; camera, scale_sigma and notes."""
        height, width = request.image.shape[:2]
        wrong = list(check_array("depth", result.depth, (height, width), "float"))
        yield from wrong
        if not wrong:
            known = result.depth[is_finite(result.depth)]
            if not len(known):
                yield "depth is NaN or infinite everywhere"
            elif (known <= 0).any():
                yield f"depth must be > 0 m or NaN, the smallest is {float(known.min()):g}"
            else:
                yield from check_median("depth", known, DEPTH_M, "m")
        if result.scale_sigma is not None:
            yield from check_sigma("scale_sigma", result.scale_sigma)
        yield from check_camera(result.intrinsics, height, width)
        yield from check_notes(result.notes)
