"""Estimate the pitch of the camera from upright edges."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

_MAX_TILT_DEG = 25.0  # from the image's vertical; a pitched camera fans upright edges out
_PITCHES_DEG = np.arange(-35.0, 36.0)  # searched
_ROLLS_DEG = np.arange(-15.0, 16.0)
_TOLERANCE_DEG = 1.5
_MIN_SEGMENTS = 20  # fewer agree by chance
_PARTS = 5  # of the segments, from left to right by turns
_LEFT_OUT = (0, 2)  # of each search


def pitch_from_segments(
    segments: FloatArray, width: int, height: int, focal_px: float, *, focal_sigma: float = 0.0
) -> tuple[float, float] | None:
    """Estimate the pitch of the camera from the vanishing point of near-vertical segments.

    Searches on parts of the segments must agree: their spread is part of the uncertainty, and so is
    the focal length, because the tangent of the pitch is the focal length over the distance of that
    vanishing point. A mirrored picture has the mirrored parts.

    Args:
        segments: (M, 2, 2) px.
        width: of the picture, px.
        height: of the picture, px.
        focal_px: focal length, px.
        focal_sigma: standard deviation of the logarithm of the focal length.

    Returns:
        How far the camera looks down and the standard deviation, degrees; None when there are too
        few upright segments or the searches disagree by more than 6 degrees.
    """

    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    rays = (segments - centre) / focal_px
    span = rays[:, 1] - rays[:, 0]
    size = np.linalg.norm(span, axis=-1)
    upright = np.abs(span[:, 1]) > np.cos(np.radians(_MAX_TILT_DEG)) * size
    rays = rays[upright]
    size = size[upright]
    if len(rays) < _MIN_SEGMENTS:
        return None
    rank = np.argsort(np.argsort(rays[..., 0].mean(1)))  # from left to right
    found = []
    for number in range(_PARTS):
        part = ~np.isin((rank - number) % _PARTS, _LEFT_OUT)
        down = _vertical_direction(rays[part], size[part])
        if down is None:
            return None
        found.append(down)
    _, vertical, forward = np.array(found).T
    pitches = np.degrees(np.arctan2(forward, vertical))
    # one search of five may go astray
    spread = float(np.sort(np.abs(pitches - np.median(pitches)))[-2])
    pitch = float(np.median(pitches))
    if spread > 6.0:
        return None
    return pitch, float(np.hypot(np.hypot(1.5, spread), focal_sigma * pitch))


def _vertical_direction(rays: FloatArray, size: FloatArray) -> FloatArray | None:
    """Estimate the direction along which the most segment length runs, on a grid and by a weighted
    refit.
    """

    ends = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], -1)
    # of a segment and the camera; gravity lies in all of them
    planes = np.cross(ends[:, 0], ends[:, 1])
    planes /= np.linalg.norm(planes, axis=-1, keepdims=True)
    middle = rays.mean(1)
    along = (rays[:, 1] - rays[:, 0]) / size[:, None]
    limit = np.sin(np.radians(_TOLERANCE_DEG))

    def worth(down: FloatArray) -> FloatArray:
        way = down[:, None, :2] - middle * down[:, None, 2:]
        way /= np.linalg.norm(way, axis=-1, keepdims=True) + 1e-12
        miss = np.abs(way[..., 0] * along[:, 1] - way[..., 1] * along[:, 0])
        return np.asarray(size * np.clip(1 - miss / limit, 0, 1))

    pitch, roll = np.meshgrid(np.radians(_PITCHES_DEG), np.radians(_ROLLS_DEG))
    down = np.stack(
        [np.sin(roll), np.cos(roll) * np.cos(pitch), np.cos(roll) * np.sin(pitch)], -1
    ).reshape(-1, 3)
    best = down[worth(down).sum(-1).argmax()]
    for _ in range(5):
        weight = worth(best[None])[0]
        if weight.sum() < 0.25 * size.sum():
            return None
        _, vectors = np.linalg.eigh((planes * weight[:, None]).T @ planes)
        best = vectors[:, 0] * (np.sign(vectors[1, 0]) or 1)
    return np.asarray(best)
