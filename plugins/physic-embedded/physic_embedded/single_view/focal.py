"""Estimate the focal length and a Manhattan frame from line segments.

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

_BOUNDS = (0.4, 2.5)  # focal lengths searched, in long sides
_ACCEPTED = (0.45, 1.6)  # 2.5 standard deviations from the default focal length: beyond, vanishing points are too far
_TOLERANCE_DEG = 2.0  # a segment that misses its vanishing point by more supports nothing
_MIN_SEGMENTS = 12


@dataclass(frozen=True)
class ManhattanFrame:
    """Focal length and three orthogonal axes, fitted to the vanishing points of line segments.

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
class _Segments:
    """Line segments in units of the long side, relative to the principal point."""

    middle: FloatArray  # (M, 2)
    direction: FloatArray  # (M, 2) unit
    length: FloatArray  # (M,)
    line: FloatArray  # (M, 3) homogeneous


def _normalised(segments: FloatArray, width: int, height: int) -> _Segments:
    """Convert segments from pixels to units of the long side."""
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    ends = (segments - centre) / max(width, height)
    span = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(span, axis=-1)
    ones = np.ones((len(ends), 1))
    line = np.cross(np.hstack([ends[:, 0], ones]), np.hstack([ends[:, 1], ones]))
    return _Segments(ends.mean(1), span / length[:, None], length, line)


def _segment_errors(lines: _Segments, axes: FloatArray, focal: FloatArray) -> FloatArray:
    """Return the sine of the angle between each segment and the direction to each vanishing point, (..., 3, M)."""

    vanishing = axes * np.stack([focal, focal, np.ones_like(focal)], -1)[..., None, :]  # (..., 3, 3)
    way = vanishing[..., None, :2] - lines.middle * vanishing[..., None, 2:]
    way /= np.linalg.norm(way, axis=-1, keepdims=True) + 1e-12
    return np.abs(way[..., 0] * lines.direction[:, 1] - way[..., 1] * lines.direction[:, 0])


def _score(lines: _Segments, axes: FloatArray, focal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the explained segment length (...,), and that of each axis (..., 3)."""

    miss = _segment_errors(lines, axes, focal)
    nearest = miss.argmin(-2)
    worth = lines.length * np.clip(1 - miss.min(-2) / np.sin(np.radians(_TOLERANCE_DEG)), 0, 1)
    by_axis = np.stack([np.where(nearest == k, worth, 0).sum(-1) for k in range(3)], -1)
    return worth.sum(-1), by_axis


def manhattan_frame(
    segments: FloatArray, width: int, height: int, *, seed: int = 0, draws: int = 1200
) -> ManhattanFrame | None:
    """Estimate the Manhattan frame whose axes fit the greatest total segment length.

    A random search is refined by least squares. Two segments give the first vanishing point; with a focal length, a
    third segment gives the second direction, because it is orthogonal to the first and lies in the plane of that
    segment and the camera.

    Args:
        segments: (M, 2, 2) px.
        width: of the picture, px.
        height: of the picture, px.
        seed: of the draws.
        draws: triples of segments; each is tried with six focal lengths.

    Returns:
        The frame, or None when there are too few segments.
    """

    if len(segments) < _MIN_SEGMENTS:
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
    axes, focal_long = _refine(lines, best[1], best[2])
    total, by_axis = _score(lines, axes, np.asarray(focal_long))
    support = by_axis / max(float(total), 1e-12)
    return ManhattanFrame(focal_long * max(width, height), axes, support, float(total / lines.length.sum()))


def _refine(lines: _Segments, axes: FloatArray, focal: float) -> tuple[FloatArray, float]:
    """Refine axes and focal length by robust least squares on the inlier segments."""
    from scipy.optimize import least_squares

    for _ in range(2):
        miss = _segment_errors(lines, axes, np.asarray(focal))
        near = miss.min(0) < np.sin(np.radians(_TOLERANCE_DEG))
        weight = np.sqrt(lines.length / lines.length.mean()) * near
        given = (lines, axes, focal, miss.argmin(0), weight)
        step = least_squares(_residual, np.zeros(4), loss="soft_l1", max_nfev=12, args=given).x
        axes, focal = _apply_step(step, axes, focal)
        focal = float(np.clip(focal, *_BOUNDS))
    return axes, focal


def _residual(
    step: FloatArray, lines: _Segments, axes: FloatArray, focal: float, owner: NDArray[np.int64], weight: FloatArray
) -> FloatArray:
    """Return the weighted errors (M,) of segments relative to their axes, in quarters of the tolerance."""

    axes, focal = _apply_step(step, axes, focal)
    miss = _segment_errors(lines, axes, np.asarray(focal))[owner, np.arange(len(owner))]
    return np.asarray(weight * miss / np.sin(np.radians(_TOLERANCE_DEG)) * 4)


def _apply_step(step: FloatArray, axes: FloatArray, focal: float) -> tuple[FloatArray, float]:
    """Rotate the axes by a rotation vector and scale the focal length by an exponential."""
    from scipy.spatial.transform import Rotation

    return axes @ Rotation.from_rotvec(step[:3]).as_matrix().T, float(focal * np.exp(step[3]))


def stable_manhattan_frame(
    segments: FloatArray,
    width: int,
    height: int,
    *,
    searches: int = 5,
    draws: int = 800,
    kept: float = 0.6,
    agreement: float = 0.2,
) -> ManhattanFrame | None:
    """Estimate the Manhattan frame, or None if searches on random subsets of the segments disagree.

    Searches on all segments agree on wrong answers too. On subsets, only a focal length that many segments support is
    found again. Searches agree if in all but at most one the focal length lies between 0.45 and 1.6 long sides, each
    axis holds more than 6 % of the explained length, and the explained length is more than 30 %. The largest of these
    focal lengths must be at most ``1 + agreement`` times the smallest. The final one must lie between the same limits.
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
    if whole is None or not max(low, min(focals) / (1 + agreement)) < whole.focal_px < min(
        high, max(focals) * (1 + agreement)
    ):
        return None
    return whole
