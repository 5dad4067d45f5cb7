"""Convert the weak-perspective camera of a square crop to a translation in the photo's camera.

Networks for the crop of one person or hand return three numbers (s, tx, ty). The body's origin projects to ``centre +
side / 2 * s * (tx, ty)``, and one metre is ``side / 2 * s`` px long there. The translation in the photo's camera
projects to the same pixel, at the depth at which one metre is that long (CLIFF, Li et al. 2022, with the principal
point instead of the image centre).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Intrinsics

_SMALLEST = 1e-6  # minimum |s|: output for an empty crop must not become an infinite depth


def translation_from_crop(weak: FloatArray, centres: FloatArray, sides: FloatArray, camera: Intrinsics) -> FloatArray:
    """Convert weak-perspective cameras of crops to translations in the photo's camera frame.

    Args:
        weak: (N, 3) s, tx, ty of each crop; s > 0.
        centres: (N, 2) px of the photo, centre of each crop; integer coordinates are pixel centres.
        sides: (N,) px of the photo, full side length of each square crop.
        camera: of the photo; focal lengths along x and y may differ.

    Returns:
        (N, 3) metres, camera frame; NaN where s is not positive.
    """
    s, shift = weak[:, 0].astype(np.float64), weak[:, 1:3].astype(np.float64)
    per_metre = sides / 2 * np.where(s > _SMALLEST, s, np.nan)
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    depth = np.sqrt(camera.fx * camera.fy) / per_metre
    pixels = centres + per_metre[:, None] * shift
    across = (pixels - centre) / focal * depth[:, None]
    return np.concatenate([across, depth[:, None]], axis=1)


def camerahmr_inputs(centres: FloatArray, sides: FloatArray, focal: float, camera: Intrinsics) -> dict[str, FloatArray]:
    """Return the box and camera inputs of CameraHMR's network, float32: input name -> array.

    The network assumes the principal point in the image centre, so boxes are shifted by the difference.

    Args:
        centres: (N, 2) px of the photo.
        sides: (N,) px of the photo.
        focal: focal length for the network, px.
        camera: of the photo.
    """
    middle = np.array([camera.width, camera.height]) / 2
    matrix = np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]])
    inputs = {
        "box_center": centres - [camera.cx, camera.cy] + middle,
        "box_size": sides,
        "img_size": np.tile([float(camera.height), float(camera.width)], (len(centres), 1)),
        "cam_int": np.tile(matrix, (len(centres), 1, 1)),
    }
    return {name: np.asarray(value, np.float32) for name, value in inputs.items()}
