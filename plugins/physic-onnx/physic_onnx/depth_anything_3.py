"""Estimate metric depth and the sky with Depth Anything 3 metric.

The depth of the network is for a focal length of 300 px.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth

from .one_graph import WEIGHTS_HELP, GraphSignature, OnnxBackend, OnnxBackendOptions, PortSpec

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.types import DepthMap, FloatArray, Hints, UInt8Array

CANONICAL_FOCAL_PX = 300.0
PATCH = 14  # px

_PICTURE = PortSpec("image", ("pixel_values", "input"), shape=(None, 3, None, None))
_ONE_VIEW = PortSpec("image", ("pixel_values",), shape=(None, 1, 3, None, None))
_OUTPUTS = (PortSpec("depth", ("predicted_depth",)), PortSpec("sky"))


class DepthAnything3Options(OnnxBackendOptions):
    """Settings of Depth Anything 3 metric."""

    weights: str = Field("depth-anything-3-metric-large", description=WEIGHTS_HELP)
    side: int = Field(
        504,
        ge=56,
        le=10_000,
        multiple_of=14,
        description="px of the input's long side where the file leaves it free",
    )
    max_patches: int = Field(
        5000, ge=64, le=100_000, description="cap on 14 px patches, which limits time and memory"
    )
    sky: float = Field(
        0.3, gt=0, lt=1, description="score from which a pixel is sky, and its depth not known"
    )
    farthest: float = Field(
        200.0, ge=1e-6, le=1e6, description="metres; larger depths become unknown"
    )


class DepthAnything3(OnnxBackend, MetricDepth):
    """Metric depth by Depth Anything 3 for a known focal length; NaN in the sky."""

    written_for = 1
    Options: ClassVar[type[OnnxBackendOptions]] = DepthAnything3Options
    options: DepthAnything3Options
    reads = ("intrinsics",)
    signatures: ClassVar = {
        "one picture": GraphSignature((_PICTURE,), _OUTPUTS),
        "several views": GraphSignature((_ONE_VIEW,), _OUTPUTS),
    }

    def check_file(self, path: Path) -> None:
        """Raise BackendError for a file of Depth Anything 3 mono, whose depth is relative.

        Both networks have the same inputs and outputs.

        Raises:
            BackendError: it is called "mono".
        """
        if "mono" in path.name.lower():
            raise BackendError(
                f"{path.name} is called after Depth Anything 3 mono, which returns relative "
                f"depth: use it as "
                "relative_pointmap 'depth-anything-onnx', or name weights of Depth Anything 3 "
                "metric"
            )

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Return depth along z in metres for the camera of ``hints``; NaN in the sky.

        Raises:
            BackendError: no camera is known, or the network is not loaded.
        """

        from physic_core.adapters.canonical_depth import depth_from_canonical
        from physic_core.adapters.pictures import resize_map
        from physic_core.types import DepthMap

        from .depth_maps import aspect_change_note, mask_depth, required_camera, squeeze_map

        loaded = self.network
        camera = required_camera(hints, image, "Depth Anything 3 metric")
        rows, columns = self._size(image)
        file = loaded.network.name
        raw, score = loaded.run_image("image", preprocess(image, rows, columns), "depth", "sky")
        values = squeeze_map(raw, "depth", file)
        # A squash changes the two focal lengths differently; the network was trained on their mean.
        seen = camera.resized(columns, rows)
        metres = depth_from_canonical(values, (seen.fx + seen.fy) / 2, CANONICAL_FOCAL_PX)
        sky = squeeze_map(score, "sky", file, may_be_flat=True) >= self.options.sky
        depth = resize_map(np.where(sky, np.nan, metres), *image.shape[:2])
        fixed = loaded.input_shape("image")[-2:] == (rows, columns)
        notes = aspect_change_note(image, rows, columns, file) if fixed else ()
        return DepthMap(mask_depth(depth, self.options.farthest), camera, notes=notes)

    def _size(self, image: UInt8Array) -> tuple[int, int]:
        """Return the input size (rows, columns)."""
        from physic_onnx.depth_maps import input_size_by_long_side, limit_patches

        from .depth_maps import fixed_input_size

        rows, columns = fixed_input_size(self.network.input_shape("image"))
        free = limit_patches(
            *input_size_by_long_side(image.shape[0], image.shape[1], self.options.side, PATCH),
            self.options.max_patches,
        )
        return rows or free[0], columns or free[1]


def preprocess(image: UInt8Array, rows: int, columns: int) -> FloatArray:
    """Resize an image (H, W, 3) to (1, 3, rows, columns) and apply ImageNet's normalisation.

    Area averaging shrinks, bicubic interpolation enlarges.
    """
    from physic_core.adapters.pictures import (
        IMAGENET_MEAN,
        IMAGENET_STD,
        normalized_nchw,
        resize_image,
    )

    grows = max(rows, columns) > max(image.shape[:2])
    return normalized_nchw(
        resize_image(image, rows, columns, "bicubic" if grows else "area"),
        IMAGENET_MEAN,
        IMAGENET_STD,
    )
