"""Convert the depth of a canonical camera to metres with the photo's focal length.

Size and distance are ambiguous without the focal length. Metric networks therefore estimate depth
for a camera of one fixed focal length. Metric depth is proportional to the focal length of the
network's input image, in px of that image. An image resized to another aspect has two focal
lengths; each formula states which one it uses.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import AnyArray, FloatArray, Hints, Intrinsics

_LEAST_INVERSE = 1e-4  # 1/m of canonical inverse depth; less becomes a depth of 10 km
_MOST_INVERSE = 1e4  # 1/m


def focal_from_fov(fov_deg: float, width: float) -> float:
    """Return the focal length in px of an image ``width`` px wide with a horizontal field of view
    in degrees.

    Raises:
        ValueError: the angle is not between 0 and 180 degrees.
    """
    if not 0 < fov_deg < 180:
        raise ValueError(f"the field of view must be between 0 and 180 degrees, got {fov_deg:g}")
    return 0.5 * width / math.tan(0.5 * math.radians(fov_deg))


def depth_from_canonical_inverse(raw: FloatArray, focal_px: float, width: float) -> FloatArray:
    """Convert canonical inverse depth, of a camera whose focal length is its image width, to
    metres.

    ``1 / z = raw * width / focal_px``. Resample inverse depth before this conversion, not metres
    after it: networks are trained so that between a near and a far surface the mean of the inverses
    is right.

    Args:
        raw: (h, w) canonical inverse depth, at any resolution.
        focal_px: horizontal focal length of the photo, px.
        width: of the same photo, px.

    Returns:
        (h, w) float32 metres along z, from 0.1 mm to 10 km.
    """
    inverse = np.asarray(raw, np.float32) * np.float32(width / focal_px)
    metres: FloatArray = 1 / np.clip(inverse, _LEAST_INVERSE, _MOST_INVERSE)
    return metres


def depth_from_canonical(raw: FloatArray, focal_px: float, canonical_focal_px: float) -> FloatArray:
    """Convert depth predicted for a canonical focal length to metres: ``raw * focal_px /
    canonical_focal_px``.

    Args:
        raw: (h, w) depth for the canonical camera, m.
        focal_px: focal length of the network's input image, px: the photo's focal length times the
            resize factor.
        canonical_focal_px: 300 for Depth Anything 3, or the network's own estimate.

    Returns:
        (h, w) float32 metres along z.
    """
    return np.asarray(raw, np.float32) * np.float32(focal_px / canonical_focal_px)


def known_camera(hints: Hints, image: AnyArray) -> Intrinsics | None:
    """Return the intrinsics in ``hints``, scaled to the size of ``image``; None if the hints have
    no intrinsics.
    """
    camera = hints.intrinsics
    height, width = image.shape[:2]
    if camera is None or (camera.width, camera.height) == (width, height):
        return camera
    return camera.resized(width, height)
