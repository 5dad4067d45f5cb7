"""The camera of a square crop and the camera of the whole photo: weak perspective there, a translation in metres here.

Networks that see one person or one hand in a square crop answer three numbers (s, tx, ty): the body's origin is seen
at ``centre + side / 2 * s * (tx, ty)``, and one metre is ``side / 2 * s`` px there. In the whole photo's camera that is
the translation whose origin is seen at the same pixel and at the depth at which a metre has that many pixels
(CLIFF, Li et al. 2022, with the principal point in place of the image's centre).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Intrinsics

__all__ = ["crop_of_translation", "told_of_crops", "translation_of_crop"]

_SMALLEST = 1e-6  # of |s|: what a network answers for nobody must not become an infinite depth


def translation_of_crop(weak: FloatArray, centres: FloatArray, sides: FloatArray, camera: Intrinsics) -> FloatArray:
    """Where the bodies' origins are in the camera of the whole photo.

    Args:
        weak: (N, 3) s, tx, ty of each crop; s > 0.
        centres: (N, 2) px of the photo, the middle of each crop; integer coordinates are pixel centres.
        sides: (N,) px of the photo, the whole side of each square crop.
        camera: of the photo; focal lengths along x and y may differ.

    Returns:
        (N, 3) metres, camera frame; NaN where s is not above zero, for then nothing was seen.
    """
    import numpy as np

    s, shift = weak[:, 0].astype(np.float64), weak[:, 1:3].astype(np.float64)
    per_metre = sides / 2 * np.where(s > _SMALLEST, s, np.nan)
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    depth = np.sqrt(camera.fx * camera.fy) / per_metre
    pixels = centres + per_metre[:, None] * shift
    across = (pixels - centre) / focal * depth[:, None]
    return np.concatenate([across, depth[:, None]], axis=1)


def told_of_crops(centres: FloatArray, sides: FloatArray, focal: float, camera: Intrinsics) -> dict[str, FloatArray]:
    """What CameraHMR's network is told of boxes and camera, by its own names, float32.

    It takes the middle of the image for the principal point, so boxes are told as they lie about the true one.

    Args:
        centres: (N, 2) px of the photo.
        sides: (N,) px of the photo.
        focal: px, the one that the network is to believe.
        camera: of the photo.
    """
    import numpy as np

    middle = np.array([camera.width, camera.height]) / 2
    matrix = np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]])
    told = {
        "box_center": centres - [camera.cx, camera.cy] + middle,
        "box_size": sides,
        "img_size": np.tile([float(camera.height), float(camera.width)], (len(centres), 1)),
        "cam_int": np.tile(matrix, (len(centres), 1, 1)),
    }
    return {name: np.asarray(value, np.float32) for name, value in told.items()}


def crop_of_translation(
    translations: FloatArray, centres: FloatArray, sides: FloatArray, camera: Intrinsics
) -> FloatArray:
    """The inverse of :func:`translation_of_crop`: (N, 3) metres with z > 0 -> (N, 3) s, tx, ty."""
    import numpy as np

    points = translations.astype(np.float64)
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    per_metre = np.sqrt(camera.fx * camera.fy) / points[:, 2]
    pixels = points[:, :2] / points[:, 2:] * focal + centre
    return np.concatenate(
        [(2 * per_metre / sides)[:, None], (pixels - centres) / per_metre[:, None]],
        axis=1,
    )
