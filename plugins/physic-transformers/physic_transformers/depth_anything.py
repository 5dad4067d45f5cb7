"""Depth Anything V2: metric, where it was trained on metres, and relative, where it answers disparity."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field

from physic_core.adapters.patch_grid import capped, least_scaled
from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD, check_photo, planes, resample, squash
from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth, Options, RelativePointmap
from physic_core.types import DepthMap, Intrinsics, Pointmap
from physic_transformers.models import WHERE, ModelOptions, Network, Part, Pretrained, array

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hints, UInt8Array

__all__ = ["DepthAnythingMetric", "DepthAnythingOptions", "DepthAnythingRelative", "MetricOptions", "RelativeOptions"]

_KIND = "DepthAnythingForDepthEstimation"
_SKY = 0.01
"""Disparity, as a share of that of the nearest percent of pixels, below which nothing tells how far away it is."""


class DepthAnythingOptions(ModelOptions):
    """What both backends share."""

    side: int = Field(
        default=518,
        ge=56,
        description="Px that the short side of a photo is brought to, the long side where the photo is smaller; a "
        "multiple of the patch, 14. 518 as trained; more shows finer detail, slowly.",
    )
    max_patches: int = Field(
        default=5000, ge=16, description="Patches of 14 x 14 px at most: long panoramas are shown smaller."
    )


class MetricOptions(DepthAnythingOptions):
    """Settings of :class:`DepthAnythingMetric`."""

    weights: str = Field(
        default="depth-anything-v2-metric-indoor-small-hf",
        description=f"Depth Anything V2 metric, indoor (to 20 m) or outdoor (to 80 m): {WHERE}.",
    )


class RelativeOptions(DepthAnythingOptions):
    """Settings of :class:`DepthAnythingRelative`."""

    weights: str = Field(default="depth-anything-v2-small-hf", description=f"Depth Anything V2, or V1: {WHERE}.")
    default_focal: float = Field(
        default=1.2, gt=0.1, le=10, description="Focal length where none is known, over the long side of the photo."
    )


class DepthAnythingMetric(Pretrained, MetricDepth):
    """Depth Anything V2 metric. It gives no focal length, and needs none."""

    Options: ClassVar[type[Options]] = MetricOptions
    options: MetricOptions
    parts: ClassVar[tuple[Part, ...]] = (Part("weights", _KIND, ("depth_anything",)),)

    def load(self, device: str = "cpu") -> None:
        """Read the weights.

        Raises:
            WeightsMissingError: they are not on this machine.
            DeviceError: the device is not there.
            BackendError: they are another model's, or of a relative one.
        """
        super().load(device)
        _require(self.network().config, "metric", "the relative_pointmap 'depth-anything-hf'")

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:  # noqa: ARG002 -- the network needs no hints
        """Image (H, W, 3) -> z-depth in metres.

        Raises:
            InputError: it is no photo.
            BackendError: ``load`` was not called.
        """
        import numpy as np

        check_photo(image)
        depth = resample(_answer(self.network(), image, self.options), *image.shape[:2])
        return DepthMap(np.where(depth > 0, depth, np.nan).astype(np.float32))


class DepthAnythingRelative(Pretrained, RelativePointmap):
    """Depth Anything relative: disparity up to scale and shift, as points of a camera."""

    Options: ClassVar[type[Options]] = RelativeOptions
    options: RelativeOptions
    parts: ClassVar[tuple[Part, ...]] = (Part("weights", _KIND, ("depth_anything",)),)

    def load(self, device: str = "cpu") -> None:
        """Read the weights.

        Raises:
            WeightsMissingError: they are not on this machine.
            DeviceError: the device is not there.
            BackendError: they are another model's, or of a metric one.
        """
        super().load(device)
        _require(self.network().config, "relative", "the metric_depth 'depth-anything-v2-metric-hf'")

    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Image (H, W, 3) -> point map whose inverse depth is open up to scale and shift.

        Raises:
            InputError: it is no photo.
            BackendError: ``load`` was not called, or the network saw nothing.
        """
        check_photo(image)
        height, width = image.shape[:2]
        disparity = resample(_answer(self.network(), image, self.options), height, width)
        camera, notes = self._camera(hints.intrinsics, height, width)
        return _points(disparity, camera, notes)

    def _camera(self, given: Intrinsics | None, height: int, width: int) -> tuple[Intrinsics, tuple[str, ...]]:
        if given is not None:
            return (given if (given.width, given.height) == (width, height) else given.resized(width, height)), ()
        source = f"default ({self.options.default_focal:g} x the long side)"
        focal = self.options.default_focal * max(height, width)
        return Intrinsics.from_focal(focal, width, height, source), (f"focal length is a {source}",)


def _answer(network: Network, image: UInt8Array, options: DepthAnythingOptions) -> FloatArray:
    """(h, w) what the network sees, at its own size."""
    patch = int(network.config.patch_size)
    size = capped(*least_scaled(*image.shape[:2], options.side, patch), options.max_patches, patch)
    pixels = planes(squash(image, *size, "bicubic-antialias"), IMAGENET_MEAN, IMAGENET_STD)
    return array(network.run(pixel_values=pixels).predicted_depth)[0]


def _points(disparity: FloatArray, camera: Intrinsics, notes: tuple[str, ...]) -> Pointmap:
    """Points with z = 1 / disparity, in units of the median distance."""
    import numpy as np

    near = float(np.percentile(disparity, 99))
    valid = np.isfinite(disparity) & (disparity > max(_SKY * near, 0.0))
    if not (near > 0 and valid.any()):
        raise BackendError("Depth Anything saw no structure in the photo: its disparity is 0 everywhere")
    height, width = disparity.shape
    unit = float(np.median(disparity[valid]))
    z = unit / np.where(valid, disparity, unit)
    u = (np.arange(width) - camera.cx) / camera.fx
    v = (np.arange(height) - camera.cy) / camera.fy
    points = np.stack([z * u[None], z * v[:, None], z], axis=-1).astype(np.float32)
    return Pointmap(points, valid, "inverse_scale_shift", camera, notes)


def _require(config: Any, kind: str, other: str) -> None:
    """Refuse metric weights where relative ones are wanted, and the other way: one grows with distance, one falls."""
    found = config.depth_estimation_type
    if found != kind:
        raise BackendError(f"these weights of Depth Anything are {found}, expected {kind} ones: they are for {other}")
