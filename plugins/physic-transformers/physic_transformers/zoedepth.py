"""Depth in metres from ZoeDepth."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.pictures import normalized_nchw, resize_map
from physic_core.interfaces import MetricDepth, Options
from physic_core.types import DepthMap
from physic_transformers.models import WHERE, ModelOptions, Part, Pretrained, array
from physic_transformers.sizes import least_change

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hints, UInt8Array

__all__ = ["ZoeDepth", "ZoeDepthOptions", "margins", "pixels", "unframed"]

_FRAME = (384, 512)  # height and width, one of which the input takes
_MULTIPLE = 32


class ZoeDepthOptions(ModelOptions):
    """Settings of :class:`ZoeDepth`."""

    weights: str = Field(default="zoedepth-nyu-kitti-hf", description=f"ZoeDepth: {WHERE}.")
    mirror: bool = Field(
        default=True, description="Ask for the mirrored photo too, and take the mean, as its authors do; twice as slow."
    )


class ZoeDepth(Pretrained, MetricDepth):
    """ZoeDepth. It sees the photo in a mirroring frame, which is cut off its answer again."""

    Options: ClassVar[type[Options]] = ZoeDepthOptions
    options: ZoeDepthOptions
    parts: ClassVar[tuple[Part, ...]] = (Part("weights", "ZoeDepthForDepthEstimation", ("zoedepth",)),)

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Image (H, W, 3) -> z-depth in metres.

        Raises:
            InputError: it is no photo.
            BackendError: ``load`` was not called.
        """

        shown = pixels(image)
        depth = array(self.network().run(pixel_values=shown).predicted_depth)[0]
        if self.options.mirror:
            mirrored = np.ascontiguousarray(shown[..., ::-1])
            depth = (depth + array(self.network().run(pixel_values=mirrored).predicted_depth)[0, :, ::-1]) / 2
        photo = unframed(depth, *image.shape[:2])
        return DepthMap(np.where(photo > 0, photo, np.nan).astype(np.float32))


def margins(height: int, width: int) -> tuple[int, int]:
    """Rows above and below a photo, and columns beside it, that the network was trained to see mirrored."""
    return int((height / 2) ** 0.5 * 3), int((width / 2) ** 0.5 * 3)


def pixels(image: UInt8Array) -> FloatArray:
    """A photo in its frame, (1, 3, h, w) from -1 to 1; corners go to corners, as ZoeDepth's own resizing does it."""
    import torch

    rows, columns = margins(*image.shape[:2])
    framed = np.pad(image, ((rows, rows), (columns, columns), (0, 0)), mode="reflect")
    tensor = torch.from_numpy(normalized_nchw(framed))
    size = least_change(framed.shape[0], framed.shape[1], _FRAME, _MULTIPLE)
    resized = torch.nn.functional.interpolate(tensor, size, mode="bilinear", align_corners=True).numpy()
    centred: FloatArray = (resized - np.float32(0.5)) / np.float32(0.5)
    return centred


def unframed(depth: FloatArray, height: int, width: int) -> FloatArray:
    """(h, w) of the photo in its frame, at any size -> (H, W) of the photo alone."""
    rows, columns = margins(height, width)
    whole = resize_map(depth, height + 2 * rows, width + 2 * columns)
    return whole[rows : rows + height, columns : columns + width]
