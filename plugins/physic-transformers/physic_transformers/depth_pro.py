"""Depth in metres and the focal length from DepthPro, as transformers answers them: inverse depth and an angle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import Field

from physic_core.adapters.canonical_depth import focal_from_fov, metres_from_inverse
from physic_core.adapters.pictures import check_photo, planes, resample, squash
from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth, Options
from physic_core.types import DepthMap, Intrinsics
from physic_transformers.models import WHERE, ModelOptions, Part, Pretrained, array

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hints, UInt8Array

__all__ = ["DepthPro", "DepthProOptions", "pixels"]

_FARTHEST = 0.5e4  # metres; what the network calls infinitely far is told as 10 km, and is not known


class DepthProOptions(ModelOptions):
    """Settings of :class:`DepthPro`."""

    weights: str = Field(default="depth-pro-hf", description=f"DepthPro: {WHERE}.")
    focal: Literal["auto", "own", "known"] = Field(
        default="auto",
        description="Which focal length turns its inverse depth into metres. 'auto': the known one where the photo, "
        "its file or the user tells it, else the network's own; 'own': always the network's; 'known': never that.",
    )


class DepthPro(Pretrained, MetricDepth):
    """DepthPro. It needs about 18 GB of memory on a CPU, and minutes."""

    Options: ClassVar[type[Options]] = DepthProOptions
    options: DepthProOptions
    capabilities: ClassVar[frozenset[str]] = frozenset({"returns_intrinsics"})
    parts: ClassVar[tuple[Part, ...]] = (Part("weights", "DepthProForDepthEstimation", ("depth_pro",)),)

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Image (H, W, 3) -> z-depth in metres, and the camera that it is for.

        Raises:
            InputError: it is no photo.
            BackendError: ``load`` was not called, or no focal length is known.
        """
        import numpy as np

        check_photo(image)
        height, width = image.shape[:2]
        network = self.network()
        out = network.run(pixel_values=pixels(image, _side(network.config)))
        camera, note = self._camera(out.field_of_view, hints.intrinsics, width, height)
        inverse = resample(array(out.predicted_depth)[0], height, width)
        depth = metres_from_inverse(inverse, camera.fx, width)
        known = np.where(depth < _FARTHEST, depth, np.nan)
        return DepthMap(known.astype(np.float32), camera, notes=(note,))

    def _camera(self, angle: Any, given: Intrinsics | None, width: int, height: int) -> tuple[Intrinsics, str]:
        """The camera that scales the depth, and where it comes from, in words."""
        wanted = self.options.focal
        if given is not None and (given.width, given.height) != (width, height):
            given = given.resized(width, height)
        known = given is not None and not given.source.startswith("default")
        if given is not None and (wanted == "known" or (wanted == "auto" and known)):
            return given, f"depth of DepthPro for the known focal length of {given.fx:.0f} px"
        if wanted == "known":
            raise BackendError("DepthPro was to take a known focal length, and none is known: take focal = 'auto'")
        if angle is None:
            raise BackendError(
                "these weights of DepthPro have no part for the field of view (use_fov_model), and no focal length is "
                "known: take the published ones, or give the camera"
            )
        degrees = float(array(angle).reshape(-1)[0])
        if not (math.isfinite(degrees) and 0 < degrees < 180):
            raise BackendError(f"DepthPro sees a field of view of {degrees:g} degrees: the photo tells it nothing")
        focal = focal_from_fov(degrees, width)
        return Intrinsics.from_focal(focal, width, height, "DepthPro"), f"focal length {focal:.0f} px from DepthPro"


def pixels(image: UInt8Array, side: int) -> FloatArray:
    """A photo squashed to (1, 3, S, S), from -1 to 1; normalised before it is resized, which is not antialiased."""
    import numpy as np

    return planes(squash(image.astype(np.float32), side, side, "bilinear"), (0.5, 0.5, 0.5), (0.5, 0.5, 0.5))


def _side(config: Any) -> int:
    """Width and height of the network's input: 1536 px of the published one."""
    return round(int(config.patch_size) / min(config.scaled_images_ratios))
