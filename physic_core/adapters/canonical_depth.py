"""Depth of a canonical camera, and what the photo's own focal length makes of it.

A network cannot tell a near small thing from a far large one without the focal length. Metric networks therefore answer
for a camera of one fixed focal length, and the metres follow by a factor: z is proportional to the focal length of the
picture that the network saw, in px of that picture. A picture that was squashed to another aspect has two focal
lengths; each formula says which one it means.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_core.types import FloatArray

__all__ = [
    "focal_from_fov",
    "focal_in_frame",
    "focal_px_of",
    "metres_from_canonical",
    "metres_from_inverse",
    "metres_of_focal",
]

_LEAST_INVERSE, _MOST_INVERSE = 1e-4, 1e4  # of metres in metres_from_inverse: what lies farther is told as 10 km


def focal_from_fov(fov_deg: float, width: float) -> float:
    """Focal length in px of a picture ``width`` px wide that sees ``fov_deg`` degrees from its left to its right edge.

    Raises:
        ValueError: an angle that no pinhole camera has.
    """
    if not 0 < fov_deg < 180:
        raise ValueError(f"a field of view lies between 0 and 180 degrees, got {fov_deg:g}")
    return 0.5 * width / math.tan(0.5 * math.radians(fov_deg))


def focal_px_of(fx: float, fy: float) -> float:
    """The one focal length of nearly square pixels: the mean of the two axes, px."""
    return 0.5 * (fx + fy)


def focal_in_frame(focal_px: float, width: float, frame_width: float) -> float:
    """The horizontal focal length of a picture ``width`` px wide, once it is resized to ``frame_width`` px."""
    return focal_px * frame_width / width


def metres_from_inverse(raw: FloatArray, focal_px: float, width: float) -> FloatArray:
    """Metres from canonical inverse depth, that of a camera whose focal length is the width of its picture.

    ``1 / z = raw * width / focal_px``. Inverse depth may be resampled before this, and metres should not be after it:
    between a near and a far surface the mean of the inverses is what the network was trained for.

    Args:
        raw: (h, w) canonical inverse depth, at any resolution.
        focal_px: horizontal focal length of the photo, px.
        width: of the same photo, px.

    Returns:
        (h, w) float32 metres along z, from 0.1 mm to 10 km.
    """
    import numpy as np

    inverse = np.asarray(raw, np.float32) * np.float32(width / focal_px)
    metres: FloatArray = 1 / np.clip(inverse, _LEAST_INVERSE, _MOST_INVERSE)
    return metres


def metres_from_canonical(raw: FloatArray, focal_px: float, canonical_focal_px: float) -> FloatArray:
    """Metres from the depth that a camera of ``canonical_focal_px`` would have seen: ``raw * focal_px / canonical``.

    Args:
        raw: (h, w) depth for the canonical camera, m.
        focal_px: of the picture as the network saw it, in its px: the photo's own times the factor of the resize.
        canonical_focal_px: 1000 for Metric3D v2, 300 for Depth Anything 3.

    Returns:
        (h, w) float32 metres along z.
    """
    import numpy as np

    metres: FloatArray = np.asarray(raw, np.float32) * np.float32(focal_px / canonical_focal_px)
    return metres


def metres_of_focal(depth: FloatArray, focal_px: float, seen_focal_px: float) -> FloatArray:
    """Depth for the focal length that is known, from depth for the one that a network believed in.

    Args:
        depth: (h, w) m, as a network gave it.
        focal_px: what is known.
        seen_focal_px: what the network believed, in px of the same picture.

    Returns:
        (h, w) float32 metres along z.
    """
    return metres_from_canonical(depth, focal_px, seen_focal_px)
