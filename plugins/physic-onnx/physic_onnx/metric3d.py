"""Metric3D v2: depth for a focal length of 1000 px of the canvas in which the photo lies."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.interfaces import MetricDepth

from .contract import Dialect, Wanted
from .one_graph import WEIGHTS, OneGraph, OneGraphOptions

if TYPE_CHECKING:
    from physic_core.adapters.pictures import Letterbox
    from physic_core.types import DepthMap, FloatArray, Hints, UInt8Array

__all__ = ["Metric3d", "Metric3dOptions", "prepare"]

CANONICAL_FOCAL_PX = 1000.0
PADDING = (123.675, 116.28, 103.53)
"""Of the canvas round the photo: ImageNet's mean, which the file turns into 0."""

_OUTPUTS = (Wanted("pred_depth", ("predicted_depth", "depth")),)


def _picture(*leading: None) -> Wanted:
    return Wanted("pixel_values", ("image",), shape=(*leading, 3, None, None))


class Metric3dOptions(OneGraphOptions):
    """Settings of Metric3D v2."""

    weights: str = Field("metric3d-v2-small", description=WEIGHTS)
    height: int = Field(616, ge=28, multiple_of=28, description="px of the canvas where the file leaves it free")
    width: int = Field(1064, ge=28, multiple_of=28, description="px of the canvas where the file leaves it free")
    farthest: float = Field(200.0, gt=0, description="metres; farther is not known, as the sky is not")


class Metric3d(OneGraph, MetricDepth):
    """Depth in metres for a known focal length; its scale follows that focal length closely."""

    Options: ClassVar[type[OneGraphOptions]] = Metric3dOptions
    options: Metric3dOptions
    dialects: ClassVar = {
        "a batch": Dialect((_picture(None),), _OUTPUTS),
        "one picture": Dialect((_picture(),), _OUTPUTS),
    }

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Image (H, W, 3) -> metres along z for the camera of ``hints``.

        Raises:
            BackendError: no camera is known, or the network is not loaded.
        """
        from physic_core.adapters.canonical_depth import depth_from_canonical
        from physic_core.adapters.pictures import resize_map
        from physic_core.types import DepthMap

        from .depth_maps import depth_at, fixed_size, required_camera, single_map

        speaking = self.speaking()
        camera = required_camera(hints, image, "Metric3D")
        rows, columns = fixed_size(speaking.shape("pixel_values"))
        size = rows or self.options.height, columns or self.options.width
        fed, box = prepare(image, *size)
        (raw,) = speaking.ask("pixel_values", fed, "pred_depth")
        values = single_map(raw, "pred_depth", speaking.network.name)
        canvas = values if values.shape == size else resize_map(values, *size)
        seen = camera.resized(box.inner[1], box.inner[0])
        metres = depth_from_canonical(box.map_to_photo(canvas), (seen.fx + seen.fy) / 2, CANONICAL_FOCAL_PX)
        return DepthMap(depth_at(metres, self.options.farthest), camera)


def prepare(image: UInt8Array, height: int, width: int) -> tuple[FloatArray, Letterbox]:
    """Image (H, W, 3) -> (1, 3, height, width) in 0..255, in the middle of a canvas, and how it lies there.

    The file itself takes off ImageNet's mean and divides by its deviation.
    """

    from physic_core.adapters.pictures import letterbox, normalized_nchw

    canvas, box = letterbox(np.asarray(image, np.float32), height, width, PADDING, "centre")
    return normalized_nchw(canvas, scale=1.0), box
