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
_STEPS = 36  # of the search, evenly spaced logarithms
_ACCEPTED = (0.45, 1.6)  # 2.5 standard deviations from the default focal length: beyond, vanishing points are too far
_TOLERANCE_DEG = 2.0  # a segment that misses its vanishing point by more supports nothing
_MIN_SEGMENTS = 12
_BY_CHANCE = 2.25  # times the root of their number: segments explained where hardly any edges are orthogonal; mean of
# the 30 photos of panoptic and roundtable in benchmarks/truth, standard deviation .34
_WEIGHT = 0.5  # independent observations a segment: most edges have two, one on each side


@dataclass(frozen=True)
class ManhattanFrame:
    """Focal length by a default and line segments together, and three orthogonal axes that fit it.

    Attributes:
        focal_px: focal length, px: geometric mean over its posterior.
        focal_sigma: standard deviation of its logarithm; that of the default where the segments say nothing.
        axes: (3, 3) rows are orthogonal unit directions in the camera frame, in no order, signs arbitrary.
    """

    focal_px: float
    focal_sigma: float
    axes: FloatArray


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


def _explained(lines: _Segments, axes: FloatArray, focal: FloatArray) -> FloatArray:
    """Return the share of the segments' length that the axes explain, (...,)."""

    miss = _segment_errors(lines, axes, focal).min(-2)
    length = np.clip(1 - miss / np.sin(np.radians(_TOLERANCE_DEG)), 0, 1) @ lines.length
    return np.asarray(length / lines.length.sum())


def manhattan_frame(
    segments: FloatArray,
    width: int,
    height: int,
    default_px: float,
    default_sigma: float,
    *,
    seed: int = 0,
    draws: int = 600,
) -> ManhattanFrame | None:
    """Estimate the focal length by a default and the segments that the best Manhattan frame of each length explains.

    Two segments give the first vanishing point; with a focal length, a third segment gives the second direction,
    because it is orthogonal to the first and lies in the plane of that segment and the camera. The best frame is
    refined by least squares.

    Args:
        segments: (M, 2, 2) px.
        width: of the picture, px.
        height: of the picture, px.
        default_px: focal length without segments, px.
        default_sigma: standard deviation of its logarithm.
        seed: of the draws.
        draws: triples of segments; each is tried with all focal lengths.

    Returns:
        The frame, or None when there are too few segments or the best focal length is implausible.
    """

    if len(segments) < _MIN_SEGMENTS:
        return None
    rng = np.random.default_rng(seed)
    lines = _normalised(segments, width, height)
    grid, columns = np.geomspace(*_BOUNDS, _STEPS), np.arange(_STEPS)
    camera = np.stack([grid, grid, np.ones_like(grid)], -1)
    # Gumbel noise on log-lengths draws triples without replacement, long segments more often.
    keys = np.log(lines.length) + rng.gumbel(size=(draws, len(segments)))
    triples = np.argpartition(-keys, 3, axis=1)[:, :3]
    share, frames = np.full(_STEPS, -1.0), np.zeros((_STEPS, 3, 3))
    for chunk in np.array_split(triples, max(1, draws * len(segments) // 5000)):
        first = np.cross(lines.line[chunk[:, 0]], lines.line[chunk[:, 1]])[:, None] / camera
        first /= np.linalg.norm(first, axis=-1, keepdims=True) + 1e-12
        second = np.cross(first, lines.line[chunk[:, 2]][:, None] * camera)
        second /= np.linalg.norm(second, axis=-1, keepdims=True) + 1e-12
        axes = np.stack([first, second, np.cross(first, second)], -2)
        found = _explained(lines, axes, np.broadcast_to(grid, axes.shape[:2]))
        best = found.argmax(0)
        better = found[best, columns] > share
        share[better], frames[better] = found[best, columns][better], axes[best, columns][better]
    log_focal, default = np.log(grid), np.log(default_px / max(width, height))
    chance = _BY_CHANCE / np.sqrt(len(segments))
    share = share.clip(chance, 1 - 1e-3)
    nats = share * np.log(share / chance) + (1 - share) * np.log((1 - share) / (1 - chance))
    log_posterior = _WEIGHT * len(segments) * nats - ((log_focal - default) / default_sigma) ** 2 / 2
    best = log_posterior.argmax()
    axes, focal = _refine(lines, frames[best], float(grid[best]))
    if not _ACCEPTED[0] < focal < _ACCEPTED[1]:
        return None
    log_focal[best] = np.log(focal)
    weight = np.exp(log_posterior - log_posterior[best])
    weight /= weight.sum()
    mean = float(weight @ log_focal)
    spread = float(np.sqrt(weight @ (log_focal - mean) ** 2))
    sigma = float(np.hypot(spread, np.log(grid[1] / grid[0])))
    return ManhattanFrame(float(np.exp(mean)) * max(width, height), sigma, axes)


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
