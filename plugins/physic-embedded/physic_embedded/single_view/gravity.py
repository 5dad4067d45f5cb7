"""Estimate the direction of gravity from upright edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_embedded.single_view.focal import ManhattanFrame

    FloatArray = NDArray[np.float64]

_MAX_TILT_DEG = 25.0  # from the image's vertical; a pitched camera fans upright edges out
_MAX_PITCH_DEG = 35.0
_MAX_ROLL_DEG = 15.0
_TOLERANCE_DEG = 1.5
_MIN_SEGMENTS = 20  # fewer agree by chance


@dataclass(frozen=True)
class Gravity:
    """Direction of gravity with its uncertainty.

    Attributes:
        down: (3,) unit vector, camera frame.
        pitch_deg: how far the camera looks down.
        sigma_deg: standard deviation of the pitch.
        source: what it was read off, in words.
    """

    down: FloatArray
    pitch_deg: float
    sigma_deg: float
    source: str


def gravity_from_manhattan_frame(frame: ManhattanFrame) -> Gravity | None:
    """Return gravity from the most vertical axis of a Manhattan frame, or None if no axis is near the vertical."""

    axis = frame.axes[np.abs(frame.axes[:, 1]).argmax()]
    down = axis * np.sign(axis[1])
    pitch, roll = _pitch_roll(down)
    if abs(pitch) > _MAX_PITCH_DEG or abs(roll) > _MAX_ROLL_DEG:
        return None
    return Gravity(down, float(pitch), 1.5, "the edges of the room")


def _pitch_roll(down: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return pitch and roll of a direction of gravity, degrees."""
    return np.degrees(np.arctan2(down[..., 2], down[..., 1])), np.degrees(np.arcsin(down[..., 0]))


def gravity_from_segments(
    segments: FloatArray,
    width: int,
    height: int,
    focal_px: float,
    *,
    focal_sigma: float = 0.0,
    searches: int = 5,
    draws: int = 600,
    kept: float = 0.6,
) -> Gravity | None:
    """Estimate gravity from the vanishing point of near-vertical segments.

    Searches on random parts of the segments must agree: their spread is part of the uncertainty, and so is the focal
    length, because the tangent of the pitch is the focal length over the distance of that vanishing point.

    Args:
        segments: (M, 2, 2) px.
        width: of the picture, px.
        height: of the picture, px.
        focal_px: focal length, px.
        focal_sigma: standard deviation of the logarithm of the focal length.
        searches: random parts.
        draws: pairs of segments a search.
        kept: share of the segments in a part.

    Returns:
        Gravity, or None when there are too few upright segments or the searches disagree by more than 6 degrees.
    """

    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    rays = (segments - centre) / focal_px
    span = rays[:, 1] - rays[:, 0]
    size = np.linalg.norm(span, axis=-1)
    upright = np.abs(span[:, 1]) > np.cos(np.radians(_MAX_TILT_DEG)) * size
    rays, size = rays[upright], size[upright]
    if len(rays) < _MIN_SEGMENTS:
        return None
    rng = np.random.default_rng(0)
    found = []
    for _ in range(searches):
        part = rng.permutation(len(rays))[: max(5, round(kept * len(rays)))]
        down = _vertical_direction(rays[part], size[part], rng, draws)
        if down is None:
            return None
        found.append(down)
    pitches, _ = _pitch_roll(np.array(found))
    spread = float(np.sort(np.abs(pitches - np.median(pitches)))[-2])  # one search of five may go astray
    down = found[int(np.abs(pitches - np.median(pitches)).argmin())]
    pitch = float(np.median(pitches))
    if spread > 6.0:
        return None
    return Gravity(down, pitch, float(np.hypot(np.hypot(1.5, spread), focal_sigma * pitch)), "upright edges")


def _vertical_direction(rays: FloatArray, size: FloatArray, rng: np.random.Generator, draws: int) -> FloatArray | None:
    """Estimate the direction along which the most segment length runs, by RANSAC on pairs and a weighted refit."""

    ends = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], -1)
    planes = np.cross(ends[:, 0], ends[:, 1])  # of a segment and the camera; gravity lies in all of them
    planes /= np.linalg.norm(planes, axis=-1, keepdims=True)
    middle = rays.mean(1)
    along = (rays[:, 1] - rays[:, 0]) / size[:, None]
    limit = np.sin(np.radians(_TOLERANCE_DEG))

    def worth(down: FloatArray) -> FloatArray:
        way = down[:, None, :2] - middle * down[:, None, 2:]
        way /= np.linalg.norm(way, axis=-1, keepdims=True) + 1e-12
        miss = np.abs(way[..., 0] * along[:, 1] - way[..., 1] * along[:, 0])
        return np.asarray(size * np.clip(1 - miss / limit, 0, 1))

    keys = np.log(size) + rng.gumbel(size=(draws, len(size)))
    pairs = np.argpartition(-keys, 2, axis=1)[:, :2]
    down = np.cross(planes[pairs[:, 0]], planes[pairs[:, 1]])
    down /= np.linalg.norm(down, axis=-1, keepdims=True) + 1e-12
    down *= np.where(down[:, 1:2] < 0, -1, 1)
    pitch, roll = _pitch_roll(down)
    down = down[(np.abs(pitch) < _MAX_PITCH_DEG) & (np.abs(roll) < _MAX_ROLL_DEG)]
    if not len(down):
        return None
    best = down[worth(down).sum(-1).argmax()]
    for _ in range(5):
        weight = worth(best[None])[0]
        if weight.sum() < 0.25 * size.sum():
            return None
        _, vectors = np.linalg.eigh((planes * weight[:, None]).T @ planes)
        best = vectors[:, 0] * (np.sign(vectors[1, 0]) or 1)
    return np.asarray(best)
