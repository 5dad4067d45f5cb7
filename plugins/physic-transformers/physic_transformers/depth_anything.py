"""Estimate depth with Depth Anything V2: metric depth, or relative disparity."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.cameras import guessed_camera, known_camera
from physic_core.adapters.disparity import clip_disparity, points_from_disparity
from physic_core.adapters.patch_grid import input_size_least_scaling, limit_patches
from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD, normalized_nchw, resize_image, resize_map
from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth, Options, RelativePointmap
from physic_core.types import DepthMap, Pointmap
from physic_transformers.models import WEIGHTS_HELP, ModelOptions, ModelSpec, Network, PretrainedBackend, to_numpy

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hints, UInt8Array

__all__ = ["DepthAnythingMetric", "DepthAnythingOptions", "DepthAnythingRelative", "MetricOptions", "RelativeOptions"]

_SATURATED = 0.98  # of the largest depth that a metric network can say


class DepthAnythingOptions(ModelOptions):
    """Settings of both Depth Anything backends."""

    side: int = Field(
        default=518,
        ge=56,
        le=10_000,
        description="Px that the short side of a photo is brought to, the long side where the photo is smaller; a "
        "multiple of the patch, 14. 518 as trained; more shows finer detail, slowly.",
    )
    max_patches: int = Field(
        default=5000, ge=16, le=100_000, description="Patches of 14 x 14 px at most: long panoramas are shown smaller."
    )


class MetricOptions(DepthAnythingOptions):
    """Settings of :class:`DepthAnythingMetric`."""

    weights: str = Field(
        default="depth-anything-v2-metric-indoor-small-hf",
        description=f"Depth Anything V2 metric, indoor (to 20 m) or outdoor (to 80 m): {WEIGHTS_HELP}.",
    )
    farthest: float | None = Field(
        default=None,
        ge=1e-6,
        le=1e6,
        description="Metres; what is farther is not known. None takes 98 % of the most that the network can say.",
    )


class RelativeOptions(DepthAnythingOptions):
    """Settings of :class:`DepthAnythingRelative`."""

    weights: str = Field(default="depth-anything-v2-small-hf", description=f"Depth Anything V2, or V1: {WEIGHTS_HELP}.")
    default_fov: float = Field(
        default=55.5,
        gt=5,
        lt=150,
        description="Field of view, degrees along the long side, where no camera is known.",
    )


class _DepthAnything(PretrainedBackend):
    """Base class of both backends, for a network that predicts metric depth or disparity, as its config states.

    Attributes:
        output_kind: "metric" or "relative": one grows with distance, the other falls.
        other_interface: what weights of the other kind are for.
    """

    specs: ClassVar[tuple[ModelSpec, ...]] = (
        ModelSpec("weights", "DepthAnythingForDepthEstimation", ("depth_anything",)),
    )
    output_kind: ClassVar[str]
    other_interface: ClassVar[str]

    def load(self, device: str = "cpu") -> None:
        """Read the weights.

        Raises:
            WeightsMissingError: they are not on this machine.
            DeviceError: the device is not there.
            BackendError: they are another model's, or answer the other thing.
        """
        super().load(device)
        found = self.network().config.depth_estimation_type
        if found != self.output_kind:
            raise BackendError(
                f"these weights of Depth Anything are {found}, expected {self.output_kind} ones: "
                f"they are for {self.other_interface}"
            )


class DepthAnythingMetric(_DepthAnything, MetricDepth):
    """Metric depth by Depth Anything V2 metric. It estimates no focal length."""

    Options: ClassVar[type[Options]] = MetricOptions
    options: MetricOptions
    output_kind, other_interface = "metric", "the relative_pointmap 'depth-anything-hf'"

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Predict the metric depth (H, W) of an image (H, W, 3); NaN where the network has no depth.

        Raises:
            InputError: it is no photo.
            BackendError: ``load`` was not called.
        """

        depth = resize_map(_answer(self.network(), image, self.options), *image.shape[:2])
        most = self.options.farthest or _SATURATED * float(self.network().config.max_depth)
        return DepthMap(np.where((depth > 0) & (depth < most), depth, np.nan).astype(np.float32))


class DepthAnythingRelative(_DepthAnything, RelativePointmap):
    """Relative point map by Depth Anything: disparity up to scale and shift, as points of a camera."""

    Options: ClassVar[type[Options]] = RelativeOptions
    options: RelativeOptions
    output_kind, other_interface = "relative", "the metric_depth 'depth-anything-v2-metric-hf'"

    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Predict the relative point map of an image (H, W, 3), and its camera.

        Raises:
            InputError: it is no photo.
            BackendError: ``load`` was not called, or the network saw nothing.
        """
        gap, lost = clip_disparity(_answer(self.network(), image, self.options))
        if lost.all():
            raise BackendError(
                "Depth Anything saw no structure in the photo, its disparity is 0 everywhere: choose another "
                "relative_pointmap, or another photo"
            )
        known = known_camera(hints, image)
        camera, notes = guessed_camera(self.options.default_fov, image) if known is None else (known, ())
        return Pointmap(*points_from_disparity(gap, lost, camera), "inverse_scale_shift", camera, notes)


def _answer(network: Network, image: UInt8Array, options: DepthAnythingOptions) -> FloatArray:
    """Run the network and return its map (h, w) at network resolution."""
    patch = int(network.config.patch_size)
    height, width = image.shape[:2]
    size = limit_patches(*input_size_least_scaling(height, width, options.side, patch), options.max_patches, patch)
    pixels = normalized_nchw(resize_image(image, *size, "bicubic-antialias"), IMAGENET_MEAN, IMAGENET_STD)
    depth: FloatArray = to_numpy(network.run(pixel_values=pixels).predicted_depth)[0]
    return depth
