"""Focal length and the directions of a Manhattan world from line segments.

Three orthogonal directions with one focal length explain most straight edges of rooms and streets. The principal point
is taken at the centre of the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

__all__ = ["ManhattanFrame", "manhattan_frame", "stable_frame"]

_BOUNDS = (0.4, 2.5)  # focal lengths searched, in long sides
_ACCEPTED = (0.45, 2.0)  # an answer nearer the bounds is the bounds' answer
_TOLERANCE_DEG = 2.0  # a segment that misses its vanishing point by more supports nothing
_FEWEST_SEGMENTS = 12


@dataclass(frozen=True)
class ManhattanFrame:
    """Focal length and axes that a set of segments agrees on.

    Attributes:
        focal_px: focal length, px.
        axes: (3, 3) rows are orthogonal unit directions in the camera frame, in no order, signs arbitrary.
        support: (3,) share of the explained length that each axis explains.
        explained: share of the segments' whole length that the axes explain.
    """

    focal_px: float
    axes: FloatArray
    support: FloatArray
    explained: float


@dataclass(frozen=True)
class _Lines:
    """Segments in units of the long side about the principal point."""

    middle: FloatArray  # (M, 2)
    direction: FloatArray  # (M, 2) unit
    length: FloatArray  # (M,)
    line: FloatArray  # (M, 3) homogeneous


def _normalised(segments: FloatArray, width: int, height: int) -> _Lines:
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    ends = (segments - centre) / max(width, height)
    span = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(span, axis=-1)
    ones = np.ones((len(ends), 1))
    line = np.cross(np.hstack([ends[:, 0], ones]), np.hstack([ends[:, 1], ones]))
    return _Lines(ends.mean(1), span / length[:, None], length, line)


def _miss(lines: _Lines, axes: FloatArray, focal: FloatArray) -> FloatArray:
    """Sine of the angle between every segment and the way from its middle to each vanishing point: (..., 3, M)."""

    vanishing = axes * np.stack([focal, focal, np.ones_like(focal)], -1)[..., None, :]  # (..., 3, 3)
    way = vanishing[..., None, :2] - lines.middle * vanishing[..., None, 2:]
    way /= np.linalg.norm(way, axis=-1, keepdims=True) + 1e-12
    return np.abs(way[..., 0] * lines.direction[:, 1] - way[..., 1] * lines.direction[:, 0])


def _score(lines: _Lines, axes: FloatArray, focal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Length explained (...,) and by which axis (..., 3)."""

    miss = _miss(lines, axes, focal)
    nearest = miss.argmin(-2)
    worth = lines.length * np.clip(1 - miss.min(-2) / np.sin(np.radians(_TOLERANCE_DEG)), 0, 1)
    by_axis = np.stack([np.where(nearest == k, worth, 0).sum(-1) for k in range(3)], -1)
    return worth.sum(-1), by_axis


def manhattan_frame(
    segments: FloatArray, width: int, height: int, *, seed: int = 0, draws: int = 1200
) -> ManhattanFrame | None:
    """The frame of ``draws`` random ones that explains the greatest length, then polished by least squares.

    Two segments give the first vanishing point; with a focal length, a third segment gives the second direction,
    because it is orthogonal to the first and lies in the plane of that segment and the camera.

    Args:
        segments: (M, 2, 2) px.
        width: of the picture, px.
        height: of the picture, px.
        seed: of the draws.
        draws: triples of segments; each is tried with six focal lengths.

    Returns:
        The frame, or None when there are too few segments.
    """

    if len(segments) < _FEWEST_SEGMENTS:
        return None
    rng = np.random.default_rng(seed)
    lines = _normalised(segments, width, height)
    grid = np.geomspace(*_BOUNDS, 36)
    # Gumbel noise on log-lengths draws triples without replacement, long segments more often.
    keys = np.log(lines.length) + rng.gumbel(size=(draws, len(segments)))
    triples = np.argpartition(-keys, 3, axis=1)[:, :3]
    best: tuple[float, FloatArray, float] | None = None
    for chunk in np.array_split(triples, max(1, draws * len(segments) // 30000)):
        focal = grid[rng.integers(0, len(grid), (len(chunk), 6))]
        camera = np.stack([focal, focal, np.ones_like(focal)], -1)
        first = np.cross(lines.line[chunk[:, 0]], lines.line[chunk[:, 1]])[:, None] / camera
        first /= np.linalg.norm(first, axis=-1, keepdims=True) + 1e-12
        second = np.cross(first, lines.line[chunk[:, 2]][:, None] * camera)
        second /= np.linalg.norm(second, axis=-1, keepdims=True) + 1e-12
        axes = np.stack([first, second, np.cross(first, second)], -2)
        total, _ = _score(lines, axes, focal)
        i, j = np.unravel_index(total.argmax(), total.shape)
        if best is None or total[i, j] > best[0]:
            best = (float(total[i, j]), axes[i, j], float(focal[i, j]))
    assert best is not None
    axes, focal_long = _polished(lines, best[1], best[2])
    total, by_axis = _score(lines, axes, np.asarray(focal_long))
    support = by_axis / max(float(total), 1e-12)
    return ManhattanFrame(focal_long * max(width, height), axes, support, float(total / lines.length.sum()))


def _polished(lines: _Lines, axes: FloatArray, focal: float) -> tuple[FloatArray, float]:
    """Axes and focal length after a robust least-squares fit to the segments that already agree."""
    from scipy.optimize import least_squares

    for _ in range(2):
        miss = _miss(lines, axes, np.asarray(focal))
        near = miss.min(0) < np.sin(np.radians(_TOLERANCE_DEG))
        weight = np.sqrt(lines.length / lines.length.mean()) * near
        given = (lines, axes, focal, miss.argmin(0), weight)
        step = least_squares(_residual, np.zeros(4), loss="soft_l1", max_nfev=12, args=given).x
        axes, focal = _stepped(step, axes, focal)
        focal = float(np.clip(focal, *_BOUNDS))
    return axes, focal


def _residual(
    step: FloatArray, lines: _Lines, axes: FloatArray, focal: float, owner: NDArray[np.int64], weight: FloatArray
) -> FloatArray:
    """Weighted misses (M,) of the segments from the axes that own them, in quarters of the tolerance."""

    axes, focal = _stepped(step, axes, focal)
    miss = _miss(lines, axes, np.asarray(focal))[owner, np.arange(len(owner))]
    return np.asarray(weight * miss / np.sin(np.radians(_TOLERANCE_DEG)) * 4)


def _stepped(step: FloatArray, axes: FloatArray, focal: float) -> tuple[FloatArray, float]:
    """Axes turned by a rotation vector, and the focal length times the exponential of the fourth number."""
    from scipy.spatial.transform import Rotation

    return axes @ Rotation.from_rotvec(step[:3]).as_matrix().T, float(focal * np.exp(step[3]))


def stable_frame(
    segments: FloatArray,
    width: int,
    height: int,
    *,
    searches: int = 5,
    draws: int = 800,
    kept: float = 0.6,
    agreement: float = 0.2,
) -> ManhattanFrame | None:
    """The Manhattan frame, if searches on random parts of the segments agree on it; None where it cannot be trusted.

    Searches that all see every segment agree on wrong answers too; seeing ``kept`` of them, only a focal length that
    many segments carry comes back. Agreed means: in all searches but at most one the focal length lies between 0.45
    and 2 long sides, each axis holds more than 6 % of what is explained, and that is more than 30 % of the whole
    length; and the largest of these focal lengths is at most ``1 + agreement`` times the smallest.
    """

    rng = np.random.default_rng(0)
    low, high = (limit * max(width, height) for limit in _ACCEPTED)
    focals = []
    for seed in range(searches):
        part = segments[rng.permutation(len(segments))[: round(kept * len(segments))]]
        frame = manhattan_frame(part, width, height, seed=seed, draws=draws)
        if frame is not None and low < frame.focal_px < high and frame.support.min() > 0.06 and frame.explained > 0.3:
            focals.append(frame.focal_px)
        if len(focals) < seed or (focals and max(focals) > (1 + agreement) * min(focals)):
            return None
    whole = manhattan_frame(segments, width, height, seed=searches, draws=draws)
    if whole is None or not min(focals) / (1 + agreement) < whole.focal_px < max(focals) * (1 + agreement):
        return None
    return whole
