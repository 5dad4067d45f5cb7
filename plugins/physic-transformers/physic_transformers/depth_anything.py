"""Depth Anything V2: metric, where it was trained on metres, and relative, where it answers disparity."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field

from physic_core.adapters.canonical_depth import focal_from_fov
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
_LEAST_GAP = 0.002  # ranges of the disparity, so that depth stays finite
_SKY = 0.004  # ranges of the disparity: the network was trained with 0 for infinity, and answers it for the sky
_SATURATED = 0.98  # of the largest depth that a metric network can say


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
    farthest: float | None = Field(
        default=None,
        gt=0,
        description="Metres; what is farther is not known. None takes 98 % of the most that the network can say.",
    )


class RelativeOptions(DepthAnythingOptions):
    """Settings of :class:`DepthAnythingRelative`."""

    weights: str = Field(default="depth-anything-v2-small-hf", description=f"Depth Anything V2, or V1: {WHERE}.")
    default_fov: float = Field(
        default=55.5,
        gt=5,
        lt=150,
        description="Field of view, degrees along the long side, where no camera is known.",
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

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Image (H, W, 3) -> z-depth in metres.

        Raises:
            InputError: it is no photo.
            BackendError: ``load`` was not called.
        """
        import numpy as np

        check_photo(image)
        depth = resample(_answer(self.network(), image, self.options), *image.shape[:2])
        most = self.options.farthest or _SATURATED * float(self.network().config.max_depth)
        return DepthMap(np.where((depth > 0) & (depth < most), depth, np.nan).astype(np.float32))


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
        disparity = _answer(self.network(), image, self.options)
        camera, notes = self._camera(hints.intrinsics, *image.shape[:2])
        return _points(disparity, camera, notes)

    def _camera(self, given: Intrinsics | None, height: int, width: int) -> tuple[Intrinsics, tuple[str, ...]]:
        if given is not None:
            return (given if (given.width, given.height) == (width, height) else given.resized(width, height)), ()
        degrees = self.options.default_fov
        source = f"default (field of view {degrees:g} degrees along the long side)"
        focal = focal_from_fov(degrees, max(height, width))
        return Intrinsics.from_focal(focal, width, height, source), (f"focal length is a {source}",)


def _answer(network: Network, image: UInt8Array, options: DepthAnythingOptions) -> FloatArray:
    """(h, w) what the network sees, at its own size."""
    patch = int(network.config.patch_size)
    size = capped(*least_scaled(*image.shape[:2], options.side, patch), options.max_patches, patch)
    pixels = planes(squash(image, *size, "bicubic-antialias"), IMAGENET_MEAN, IMAGENET_STD)
    return array(network.run(pixel_values=pixels).predicted_depth)[0]


def _points(disparity: FloatArray, camera: Intrinsics, notes: tuple[str, ...]) -> Pointmap:
    """Points with z = 1 / disparity, in units of the median distance.

    Args:
        disparity: (h, w), larger is nearer, at any size.
        camera: of the photo.
        notes: of the answer.
    """
    import numpy as np

    low, high = np.percentile(disparity, [1, 99])
    span = max(float(high - low), 1e-6)
    lost = ~(disparity >= _SKY * span)
    if lost.all():
        raise BackendError("Depth Anything saw no structure in the photo: its disparity is 0 everywhere")
    gap = np.maximum(np.where(lost, 0.0, disparity), _LEAST_GAP * span)
    # Between a near and a far surface the inverse is what may be averaged.
    z = 1 / resample(gap / np.median(gap[~lost]), camera.height, camera.width)
    valid = resample(lost, camera.height, camera.width) < 0.5
    u = ((np.arange(camera.width) - camera.cx) / camera.fx).astype(np.float32)
    v = ((np.arange(camera.height) - camera.cy) / camera.fy).astype(np.float32)
    points = np.stack([z * u[None], z * v[:, None], z], axis=-1).astype(np.float32)
    return Pointmap(points, valid, "inverse_scale_shift", camera, notes)


def _require(config: Any, kind: str, other: str) -> None:
    """Refuse metric weights where relative ones are wanted, and the other way: one grows with distance, one falls."""
    found = config.depth_estimation_type
    if found != kind:
        raise BackendError(f"these weights of Depth Anything are {found}, expected {kind} ones: they are for {other}")
