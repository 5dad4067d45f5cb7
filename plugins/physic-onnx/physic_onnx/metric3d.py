"""Estimate metric depth with Metric3D v2.

The depth of the network is for a focal length of 1000 px in the letterboxed input.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.interfaces import MetricDepth

from .contract import GraphSignature, PortSpec
from .one_graph import WEIGHTS_HELP, OnnxBackend, OnnxBackendOptions

if TYPE_CHECKING:
    from physic_core.adapters.pictures import Letterbox
    from physic_core.types import DepthMap, FloatArray, Hints, UInt8Array

CANONICAL_FOCAL_PX = 1000.0
PADDING = (123.675, 116.28, 103.53)
"""Padding colour: ImageNet's mean, which the network normalises to 0."""

_OUTPUTS = (PortSpec("pred_depth", ("predicted_depth", "depth")),)


def _picture(*leading: None) -> PortSpec:
    return PortSpec("pixel_values", ("image",), shape=(*leading, 3, None, None))


class Metric3dOptions(OnnxBackendOptions):
    """Settings of Metric3D v2."""

    weights: str = Field("metric3d-v2-small", description=WEIGHTS_HELP)
    height: int = Field(
        616, ge=28, le=4096, multiple_of=28, description="px of the canvas where the file leaves it free"
    )
    width: int = Field(
        1064, ge=28, le=4096, multiple_of=28, description="px of the canvas where the file leaves it free"
    )
    farthest: float = Field(200.0, ge=1e-6, le=1e6, description="metres; farther is not known, as the sky is not")


class Metric3d(OnnxBackend, MetricDepth):
    """Metric depth by Metric3D v2. The depth is proportional to the focal length, which must be known."""

    Options: ClassVar[type[OnnxBackendOptions]] = Metric3dOptions
    options: Metric3dOptions
    reads = ("intrinsics",)
    signatures: ClassVar = {
        "a batch": GraphSignature((_picture(None),), _OUTPUTS),
        "one picture": GraphSignature((_picture(),), _OUTPUTS),
    }

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Return depth along z in metres for the camera of ``hints``.

        Raises:
            BackendError: no camera is known, or the network is not loaded.
        """
        from physic_core.adapters.canonical_depth import depth_from_canonical
        from physic_core.adapters.pictures import resize_map
        from physic_core.types import DepthMap

        from .depth_maps import fixed_input_size, mask_depth, required_camera, squeeze_map

        loaded = self.loaded()
        camera = required_camera(hints, image, "Metric3D")
        rows, columns = fixed_input_size(loaded.input_shape("pixel_values"))
        size = rows or self.options.height, columns or self.options.width
        fed, box = preprocess(image, *size)
        (raw,) = loaded.run_image("pixel_values", fed, "pred_depth")
        values = squeeze_map(raw, "pred_depth", loaded.network.name)
        canvas = values if values.shape == size else resize_map(values, *size)
        seen = camera.resized(box.inner[1], box.inner[0])
        metres = depth_from_canonical(box.map_to_photo(canvas), (seen.fx + seen.fy) / 2, CANONICAL_FOCAL_PX)
        return DepthMap(mask_depth(metres, self.options.farthest), camera)


def preprocess(image: UInt8Array, height: int, width: int) -> tuple[FloatArray, Letterbox]:
    """Letterbox an image (H, W, 3) to (1, 3, height, width), centred, values 0 to 255. Also return the letterbox.

    The ONNX file itself subtracts ImageNet's mean and divides by its standard deviation.
    """

    from physic_core.adapters.pictures import letterbox, normalized_nchw

    canvas, box = letterbox(np.asarray(image, np.float32), height, width, PADDING, "centre")
    return normalized_nchw(canvas, scale=1.0), box
