"""Estimate metric depth with ZoeDepth."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.networks import picture_tensor, to_numpy
from physic_core.adapters.pictures import resize_map
from physic_core.interfaces import MetricDepth, Options
from physic_core.types import DepthMap
from physic_transformers.models import WEIGHTS_HELP, ModelOptions, ModelSpec, PretrainedBackend, size_from_target

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hints, UInt8Array

_FRAME = (384, 512)  # height and width, one of which the input takes
_MULTIPLE = 32


class ZoeDepthOptions(ModelOptions):
    """Settings of :class:`ZoeDepth`."""

    weights: str = Field(default="zoedepth-nyu-kitti-hf", description=f"ZoeDepth: {WEIGHTS_HELP}.")
    mirror: bool = Field(
        default=True, description="Ask for the mirrored photo too, and take the mean, as its authors do; twice as slow."
    )


class ZoeDepth(PretrainedBackend, MetricDepth):
    """Metric depth by ZoeDepth. The photo is padded by reflection, and the padding is removed from the depth."""

    written_for = 1
    Options: ClassVar[type[Options]] = ZoeDepthOptions
    options: ZoeDepthOptions
    reads = ()
    specs: ClassVar[tuple[ModelSpec, ...]] = (ModelSpec("weights", "ZoeDepthForDepthEstimation", ("zoedepth",)),)

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Return z-depth in metres of an image (H, W, 3).

        Raises:
            InputError: it is not a valid photo.
            BackendError: ``load`` was not called.
        """

        shown = preprocess(image, self.device)
        depth = to_numpy(self.model().run(pixel_values=shown).predicted_depth)[0]
        if self.options.mirror:
            mirrored = shown.flip(-1)
            depth = (depth + to_numpy(self.model().run(pixel_values=mirrored).predicted_depth)[0, :, ::-1]) / 2
        photo = crop_padding(depth, *image.shape[:2])
        return DepthMap(np.where(photo > 0, photo, np.nan).astype(np.float32))


def reflection_margins(height: int, width: int) -> tuple[int, int]:
    """Return the number of rows above and below, and of columns beside a photo for reflection padding.

    The network was trained with the same padding.
    """
    return int((height / 2) ** 0.5 * 3), int((width / 2) ** 0.5 * 3)


def preprocess(image: UInt8Array, device: str = "cpu") -> Any:
    """Pad and resize a photo to (1, 3, h, w) in [-1, 1]; corners are aligned, as in ZoeDepth's own resizing."""
    rows, columns = reflection_margins(*image.shape[:2])
    framed = np.pad(image, ((rows, rows), (columns, columns), (0, 0)), mode="reflect")
    size = size_from_target(framed.shape[0], framed.shape[1], _FRAME, _MULTIPLE)
    half = (0.5, 0.5, 0.5)
    return picture_tensor(framed, half, half, size=size, align_corners=True, device=device)


def crop_padding(depth: FloatArray, height: int, width: int) -> FloatArray:
    """Resize a padded map (h, w) and return the part (H, W) without padding."""
    rows, columns = reflection_margins(height, width)
    whole = resize_map(depth, height + 2 * rows, width + 2 * columns)
    return whole[rows : rows + height, columns : columns + width]
