"""DepthPro: metres and the focal length, from 1536 x 1536 px.

Two forms of the file are about. The published ONNX file answers metres, for the focal length that it found, which it
tells in px of the 1536 px wide square. An export of the class in transformers answers canonical inverse depth and a
field of view.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth

from .contract import Dialect, Wanted
from .one_graph import WEIGHTS, OneGraph, OneGraphOptions

if TYPE_CHECKING:
    from physic_core.types import DepthMap, FloatArray, Hints, UInt8Array

    from .one_graph import Speaking

__all__ = ["DepthPro", "DepthProOptions", "prepare"]

SIDE = 1536
_TELLING = 0.1  # share by which two focal lengths differ before it is worth a note
_PICTURE = Wanted("pixel_values", ("image", "input"), shape=(None, 3, SIDE, SIDE))
METRES, INVERSE = "metres and focal length in px", "canonical inverse depth and field of view"


class DepthProOptions(OneGraphOptions):
    """Settings of DepthPro."""

    weights: str = Field("depth-pro-fp16", description=WEIGHTS)
    use_known_focal: bool = Field(
        True, description="scale depth to the focal length that is known; false keeps DepthPro's own"
    )
    farthest: float = Field(1000.0, gt=0, description="metres; farther is not known: DepthPro puts the sky at 10 km")


class DepthPro(OneGraph, MetricDepth):
    """Depth in metres and the camera (paper's MetricDepth). On a CPU it takes minutes and about 18 GB of memory."""

    Options: ClassVar[type[OneGraphOptions]] = DepthProOptions
    options: DepthProOptions
    capabilities = ("returns_intrinsics",)
    dialects: ClassVar = {
        METRES: Dialect((_PICTURE,), (Wanted("predicted_depth", ("depth",)), Wanted("focallength_px"))),
        INVERSE: Dialect((_PICTURE,), (Wanted("predicted_depth"), Wanted("field_of_view", ("fov", "fov_deg")))),
    }

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Image (H, W, 3) -> metres along z and the camera; NaN in the sky.

        Depth is proportional to the focal length: a camera of ``hints``, unless it is a default, replaces the one that
        the network found.
        """
        from physic_core.adapters.cameras import known_camera
        from physic_core.adapters.canonical_depth import depth_from_canonical
        from physic_core.types import DepthMap, Intrinsics

        from .depth_maps import depth_at

        speaking = self.speaking()
        height, width = image.shape[:2]
        depth, own = self._metres(speaking, image)
        camera = Intrinsics.from_focal(own, width, height, "DepthPro")
        notes = [f"focal length {own:.0f} px from DepthPro"]
        known = known_camera(hints, image) if self.options.use_known_focal else None
        if known is not None and not known.guessed:
            depth, camera = depth_from_canonical(depth, known.fx, own), known
            notes = []
            if abs(known.fx / own - 1) > _TELLING:
                notes = [f"DepthPro took the focal length for {own:.0f} px; its depth is scaled to {known.fx:.0f} px"]
        return DepthMap(depth_at(depth, self.options.farthest), camera, notes=tuple(notes))

    def _metres(self, speaking: Speaking, image: UInt8Array) -> tuple[FloatArray, float]:
        """Depth at the photo's size and focal length in px of the photo, both as the network believes."""

        from physic_core.adapters.canonical_depth import depth_from_canonical_inverse, focal_from_fov
        from physic_core.adapters.pictures import resize_map

        from .depth_maps import one_number, single_map

        height, width = image.shape[:2]
        file = speaking.network.name
        inverse_is_told = speaking.dialect == INVERSE
        second = "field_of_view" if inverse_is_told else "focallength_px"
        raw, told = speaking.ask("pixel_values", prepare(image), "predicted_depth", second)
        values, number = single_map(raw, "predicted_depth", file), one_number(told, second, file)
        # Between a near and a far surface the inverse is what may be averaged, in both forms.
        if inverse_is_told:
            if number >= 180:
                raise BackendError(f"{file} answered a field of view of {number:g} degrees: less than 180 was expected")
            focal = focal_from_fov(number, width)
            return depth_from_canonical_inverse(resize_map(values, height, width), focal, width), focal
        with np.errstate(divide="ignore"):
            inverse = resize_map(np.where(values > 0, 1 / values, 0.0), height, width)
            metres: FloatArray = (1 / inverse).astype(np.float32)
        return metres, number * width / SIDE


def prepare(image: UInt8Array) -> FloatArray:
    """Image (H, W, 3) -> (1, 3, 1536, 1536) in [-1, 1]: squashed, bilinear, not antialiased, and never rounded.

    The published processor normalises first and resizes then, which in float32 is the same.
    """

    from physic_core.adapters.pictures import normalized_nchw, resize_image

    return normalized_nchw(resize_image(np.asarray(image, np.float32), SIDE, SIDE, "bilinear"), (0.5,) * 3, (0.5,) * 3)
