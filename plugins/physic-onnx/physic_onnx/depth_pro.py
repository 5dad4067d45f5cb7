"""Estimate metric depth and the focal length with DepthPro at 1536 x 1536 px.

Two forms of the file exist. The published ONNX file returns metres and its focal length in px of the 1536 px square. An
export of the class in transformers returns canonical inverse depth and a field of view.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth

from .contract import GraphSignature, PortSpec
from .one_graph import WEIGHTS_HELP, OnnxBackend, OnnxBackendOptions

if TYPE_CHECKING:
    from physic_core.types import DepthMap, FloatArray, Hints, UInt8Array

    from .one_graph import LoadedGraph

__all__ = ["DepthPro", "DepthProOptions", "preprocess"]

SIDE = 1536
_TELLING = 0.1  # share by which two focal lengths differ before it is worth a note
_PICTURE = PortSpec("pixel_values", ("image", "input"), shape=(None, 3, SIDE, SIDE))
METRES, INVERSE = "metres and focal length in px", "canonical inverse depth and field of view"


class DepthProOptions(OnnxBackendOptions):
    """Settings of DepthPro."""

    weights: str = Field("depth-pro-fp16", description=WEIGHTS_HELP)
    use_known_focal: bool = Field(
        True, description="scale depth to the focal length that is known; false keeps DepthPro's own"
    )
    farthest: float = Field(
        1000.0, ge=1e-6, le=1e6, description="metres; farther is not known: DepthPro puts the sky at 10 km"
    )


class DepthPro(OnnxBackend, MetricDepth):
    """Metric depth and camera by DepthPro, as in the PhySIC paper.

    On a CPU, the network takes minutes and about 18 GB of memory.
    """

    Options: ClassVar[type[OnnxBackendOptions]] = DepthProOptions
    options: DepthProOptions
    capabilities = ("returns_intrinsics",)
    signatures: ClassVar = {
        METRES: GraphSignature((_PICTURE,), (PortSpec("predicted_depth", ("depth",)), PortSpec("focallength_px"))),
        INVERSE: GraphSignature(
            (_PICTURE,), (PortSpec("predicted_depth"), PortSpec("field_of_view", ("fov", "fov_deg")))
        ),
    }

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Return depth along z in metres and the camera; NaN in the sky.

        Depth is proportional to the focal length: a camera of ``hints``, unless it is a default, replaces the one that
        the network found.
        """
        from physic_core.adapters.cameras import known_camera
        from physic_core.adapters.canonical_depth import depth_from_canonical
        from physic_core.types import DepthMap, Intrinsics

        from .depth_maps import mask_depth

        loaded = self.loaded()
        height, width = image.shape[:2]
        depth, own = self._metres(loaded, image)
        camera = Intrinsics.from_focal(own, width, height, "DepthPro")
        notes = [f"focal length {own:.0f} px from DepthPro"]
        known = known_camera(hints, image) if self.options.use_known_focal else None
        if known is not None and not known.guessed:
            depth, camera = depth_from_canonical(depth, known.fx, own), known
            notes = []
            if abs(known.fx / own - 1) > _TELLING:
                notes = [f"DepthPro took the focal length for {own:.0f} px; its depth is scaled to {known.fx:.0f} px"]
        return DepthMap(mask_depth(depth, self.options.farthest), camera, notes=tuple(notes))

    def _metres(self, loaded: LoadedGraph, image: UInt8Array) -> tuple[FloatArray, float]:
        """Return depth at photo size and focal length in photo px, both as estimated by the network."""

        from physic_core.adapters.canonical_depth import depth_from_canonical_inverse, focal_from_fov
        from physic_core.adapters.pictures import resize_map

        from .depth_maps import squeeze_map, squeeze_number

        height, width = image.shape[:2]
        file = loaded.network.name
        returns_inverse = loaded.signature == INVERSE
        second = "field_of_view" if returns_inverse else "focallength_px"
        raw, focal_output = loaded.run_image("pixel_values", preprocess(image), "predicted_depth", second)
        values, number = squeeze_map(raw, "predicted_depth", file), squeeze_number(focal_output, second, file)
        # Between a near and a far surface the inverse is what may be averaged, in both forms.
        if returns_inverse:
            if number >= 180:
                raise BackendError(f"{file} returned a field of view of {number:g} degrees: less than 180 was expected")
            focal = focal_from_fov(number, width)
            return depth_from_canonical_inverse(resize_map(values, height, width), focal, width), focal
        with np.errstate(divide="ignore"):
            inverse = resize_map(np.where(values > 0, 1 / values, 0.0), height, width)
            metres: FloatArray = (1 / inverse).astype(np.float32)
        return metres, number * width / SIDE


def preprocess(image: UInt8Array) -> FloatArray:
    """Stretch an image (H, W, 3) to (1, 3, 1536, 1536) in [-1, 1], bilinear without antialiasing or rounding.

    The published processor normalises first and resizes then, which in float32 is the same.
    """

    from physic_core.adapters.pictures import normalized_nchw, resize_image

    return normalized_nchw(resize_image(np.asarray(image, np.float32), SIDE, SIDE, "bilinear"), (0.5,) * 3, (0.5,) * 3)
