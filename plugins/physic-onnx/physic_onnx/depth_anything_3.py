"""Depth Anything 3 metric: depth for a focal length of 300 px of the network's own picture, and the sky."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth

from .contract import Dialect, Wanted
from .one_graph import WEIGHTS, OneGraph, OneGraphOptions

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.types import DepthMap, FloatArray, Hints, UInt8Array

__all__ = ["DepthAnything3", "DepthAnything3Options", "prepare"]

CANONICAL_FOCAL_PX = 300.0
PATCH = 14  # px

_PICTURE = Wanted("image", ("pixel_values", "input"), shape=(None, 3, None, None))
_ONE_VIEW = Wanted("image", ("pixel_values",), shape=(None, 1, 3, None, None))
_OUTPUTS = (Wanted("depth", ("predicted_depth",)), Wanted("sky"))


class DepthAnything3Options(OneGraphOptions):
    """Settings of Depth Anything 3 metric."""

    weights: str = Field("depth-anything-3-metric-large", description=WEIGHTS)
    side: int = Field(
        504, ge=56, multiple_of=14, description="px of the input's long side where the file leaves it free"
    )
    max_patches: int = Field(5000, ge=64, description="cap on 14 px patches, which limits time and memory")
    sky: float = Field(0.3, gt=0, lt=1, description="score from which a pixel is sky, and its depth not known")
    farthest: float = Field(200.0, gt=0, description="metres; farther is not known")


class DepthAnything3(OneGraph, MetricDepth):
    """Depth in metres for a known focal length, and no depth in the sky."""

    Options: ClassVar[type[OneGraphOptions]] = DepthAnything3Options
    options: DepthAnything3Options
    dialects: ClassVar = {
        "one picture": Dialect((_PICTURE,), _OUTPUTS),
        "several views": Dialect((_ONE_VIEW,), _OUTPUTS),
    }

    def check_file(self, path: Path) -> None:
        """Refuse the relative file with a sky, whose ports are the same.

        Raises:
            BackendError: it is called "mono".
        """
        if "mono" in path.name.lower():
            raise BackendError(
                f"{path.name} is called after Depth Anything 3 mono, which answers relative depth: use it as "
                "relative_pointmap 'depth-anything-onnx', or name weights of Depth Anything 3 metric"
            )

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Image (H, W, 3) -> metres along z for the camera of ``hints``; NaN in the sky.

        Raises:
            BackendError: no camera is known, or the network is not loaded.
        """

        from physic_core.adapters.canonical_depth import depth_from_canonical
        from physic_core.adapters.pictures import resize_map
        from physic_core.types import DepthMap

        from .depth_maps import depth_at, required_camera, single_map, squash_note

        speaking = self.speaking()
        camera = required_camera(hints, image, "Depth Anything 3 metric")
        rows, columns = self._size(image)
        file = speaking.network.name
        raw, score = speaking.ask("image", prepare(image, rows, columns), "depth", "sky")
        values = single_map(raw, "depth", file)
        # A squash changes the two focal lengths differently; the network was trained on their mean.
        seen = camera.resized(columns, rows)
        metres = depth_from_canonical(values, (seen.fx + seen.fy) / 2, CANONICAL_FOCAL_PX)
        sky = single_map(score, "sky", file, may_be_flat=True) >= self.options.sky
        depth = resize_map(np.where(sky, np.nan, metres), *image.shape[:2])
        fixed = speaking.shape("image")[-2:] == (rows, columns)
        notes = squash_note(image, rows, columns, file) if fixed else ()
        return DepthMap(depth_at(depth, self.options.farthest), camera, notes=notes)

    def _size(self, image: UInt8Array) -> tuple[int, int]:
        from physic_core.adapters.patch_grid import input_size_by_long_side, limit_patches

        from .depth_maps import fixed_size

        rows, columns = fixed_size(self.speaking().shape("image"))
        free = limit_patches(
            *input_size_by_long_side(image.shape[0], image.shape[1], self.options.side, PATCH), self.options.max_patches
        )
        return rows or free[0], columns or free[1]


def prepare(image: UInt8Array, rows: int, columns: int) -> FloatArray:
    """Image (H, W, 3) -> (1, 3, rows, columns), ImageNet's normalisation; shrunk by areas, enlarged bicubically."""
    from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD, normalized_nchw, resize_image

    grows = max(rows, columns) > max(image.shape[:2])
    return normalized_nchw(
        resize_image(image, rows, columns, "bicubic" if grows else "area"), IMAGENET_MEAN, IMAGENET_STD
    )
