"""Linear colours and CIE Lab, white D65, of sRGB colours."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import Float32Array, Float64Array, UInt8Array


_XYZ = np.array(
    [[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]]
) / [[0.950456], [1.0], [1.088754]]
"""CIE XYZ, as shares of those of white, of linear red, green and blue."""

_LINEAR = 0.008856  # share of white below which Lab is linear in XYZ


def linear_from_srgb(colors: UInt8Array) -> Float64Array:
    """Return linear colours in 0-1 of sRGB 0-255, as glTF and USD state colours of vertices."""
    share = np.arange(256) / 255
    table = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return table[colors]


def lab_from_srgb(colors: UInt8Array) -> Float32Array:
    """Return CIE Lab (..., 3), L in 0-100, of sRGB colours (..., 3) 0-255.

    OpenCV's first conversion makes a table, which takes .07 s, ten times as long as a small picture
    here.
    """
    xyz = linear_from_srgb(colors).astype(np.float32) @ _XYZ.T.astype(np.float32)
    shares = np.where(xyz > _LINEAR, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    x, y, z = (shares[..., axis] for axis in range(3))
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], -1, dtype=np.float32)
