"""Estimate relative points with Depth Anything V2 small: the float32 file in the wheel of the
embedded networks, which takes pixels from 0 to 255.

It returns disparity: inverse depth up to scale and shift, larger is nearer. The network was trained
with 0 for infinity, and returns it for the sky.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import RelativePointmap
from physic_core.types import CameraTrust, Intrinsics, Pointmap
from physic_networks.canonical_depth import focal_from_fov, known_camera
from physic_networks.networks import WEIGHTS_HELP
from physic_networks.pictures import normalized_nchw, resize_image, resize_map

from .sessions import OnnxBackend, OnnxOptions

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Hints, UInt8Array

_SIDE = 518  # px; a multiple of a patch
_PATCH = 14  # px
_MAX_PATCHES = 5000  # limits time and memory of long panoramas, which grow with its square
_DEFAULT_FOV = 55.5  # degrees along the long side, where no camera is known
_LEAST_SPREAD = 1e-6  # of the largest value; below it a map is a constant
_LEAST_GAP = 0.002  # ranges of the disparity to the farthest point: depth stays finite
_SKY = 0.004  # ranges of the disparity


class DepthAnythingOptions(OnnxOptions):
    """Settings of Depth Anything."""

    weights: str = Field("depth-anything-v2-small", description=WEIGHTS_HELP)


class DepthAnything(OnnxBackend, RelativePointmap):
    """Relative point map by Depth Anything V2, up to scale and shift of inverse depth."""

    written_for = 1
    Options = DepthAnythingOptions
    options: DepthAnythingOptions
    reads = ("intrinsics",)

    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Predict the relative point map of an image (H, W, 3); points without depth are invalid.

        Raises:
            BackendError: the network is not loaded, or sees nothing.
        """
        rows, columns = input_size(image.shape[0], image.shape[1])
        picture = resize_image(image, rows, columns, "bicubic-antialias")
        (disparity,) = self.network.run({"image": normalized_nchw(picture, scale=1.0)}, ["depth"])
        gap, is_unreliable = clip_disparity(disparity[0])
        if is_unreliable.all() or np.ptp(gap) <= _LEAST_SPREAD * gap.max():
            raise BackendError(
                f"{self.network.name} detects no structure in the photo: no pixel has a depth"
            )
        camera = known_camera(hints, image)
        notes: tuple[str, ...] = ()
        if camera is None:
            height, width = image.shape[:2]
            source = f"default (field of view {_DEFAULT_FOV:g} degrees along the long side)"
            focal = focal_from_fov(_DEFAULT_FOV, max(height, width))
            camera = Intrinsics.from_focal(focal, width, height, source, CameraTrust.GUESSED)
            notes = (f"focal length is a {source}",)
        points, valid = points_from_disparity(gap, is_unreliable, camera)
        return Pointmap(points, valid, "inverse_scale_shift", camera, notes)


def input_size(height: int, width: int) -> tuple[int, int]:
    """Return rows and columns of the input for a photo, px: 518 along the side that needs less
    scaling, both sides in whole patches, and 5000 patches at most.
    """
    scale = min((_SIDE / height, _SIDE / width), key=lambda factor: abs(1 - factor))
    rows, columns = (max(1, round(scale * side / _PATCH)) for side in (height, width))
    if rows * columns > _MAX_PATCHES:
        shrink = math.sqrt(_MAX_PATCHES / (rows * columns))
        rows, columns = max(1, int(rows * shrink)), max(1, int(columns * shrink))
    return rows * _PATCH, columns * _PATCH


def clip_disparity(disparity: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Clip disparity (h, w) to a small positive minimum, and return a mask (h, w) of sky and NaN
    pixels.
    """
    low, high = np.percentile(disparity, [1, 99])
    span = max(float(high - low), 1e-6)
    lost: BoolArray = np.asarray(~(disparity >= _SKY * span))
    gap: FloatArray = np.maximum(np.where(lost, 0.0, disparity), _LEAST_GAP * span)
    return gap, lost


def points_from_disparity(
    gap: FloatArray, lost: BoolArray, camera: Intrinsics
) -> tuple[FloatArray, BoolArray]:
    """Compute points on the rays of a camera with z = 1 / disparity, in units of the median
    distance.

    Args:
        gap: (h, w) positive inverse depth, at any resolution.
        lost: (h, w) bool, pixels without a value; not all.
        camera: of the photo.

    Returns:
        (H, W, 3) float32 points, and (H, W) bool, which are valid.
    """
    # Resample the inverse depth: it may be averaged between a near and a far surface.
    z = 1 / resize_map(gap / np.median(gap[~lost]), camera.height, camera.width)
    valid = resize_map(lost, camera.height, camera.width) < 0.5
    u = ((np.arange(camera.width) - camera.cx) / camera.fx).astype(np.float32)
    v = ((np.arange(camera.height) - camera.cy) / camera.fy).astype(np.float32)
    return np.stack([z * u[None], z * v[:, None], z], axis=-1).astype(np.float32), valid
