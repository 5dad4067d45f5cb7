"""Read the depth map that a phone stores beside its photo in a HEIC file.

Phones of Apple store disparity in 8 bits and its range in units of 1 / metre ("pixelShift / (pixelFocalLength *
baselineInMeters)", Apple's page "Creating Auxiliary Depth Data Manually"). Where two cameras measured it, the file
calls it relative: its order is right, its size is not promised.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError
from physic_core.files.image_file import ImageSource, open_image, wrap_decoding_errors

if TYPE_CHECKING:
    from physic_core.types import FloatArray

HEIC_SUFFIXES = (".heic", ".heif", ".hif")
_UNIFORM_DISPARITY = 1
_RELATIVE = re.compile(rb"depthData:Accuracy\W{1,4}relative")


def read_phone_depth(path: Path) -> tuple[FloatArray, bool]:
    """Return the depth (H, W) in metres, inf at infinity, and whether the file calls it relative.

    Raises:
        PackageMissingError: the package pi-heif is not installed.
        InputError: the file cannot be read, has no depth map, or one of another kind than disparity with its range.
    """
    source = ImageSource(str(path), path=path, what="depth map", formats="a HEIC photo of a phone that stores depth")
    with open_image(source) as (image, file):
        found = image.info.get("depth_images")
        if not found:
            raise InputError(
                f"the photo {path} has no depth map: take one in portrait mode, or give the depth in another file"
            )
        kind = found[0].info["metadata"]
        if kind.get("representation_type") != _UNIFORM_DISPARITY or not {"d_min", "d_max"} <= kind.keys():
            raise InputError(
                f"the depth map in {path} is not disparity with its range (it says {kind or 'nothing'}), so its metres "
                "are not known; convert it to .npy"
            )
        with wrap_decoding_errors(source):
            values = np.asarray(found[0].to_pillow())
            file.seek(0)
            is_relative = _RELATIVE.search(file.read()) is not None
    if values.ndim != 2 or values.dtype != np.uint8:
        raise InputError(f"the depth map in {path} must have one channel of 8 bits, got {values.shape} {values.dtype}")
    disparity = kind["d_min"] + (kind["d_max"] - kind["d_min"]) * values.astype(np.float64) / 255
    with np.errstate(divide="ignore"):
        return np.where(disparity > 0, 1 / disparity, np.inf), is_relative
