"""Estimate the focal length and the directions of a room from line segments.

Three orthogonal directions with one focal length explain most straight edges of rooms and streets.
The principal point is taken at the centre of the picture. All searches run over fixed grids that
are their own mirror image, so that a mirrored picture has the mirrored answer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import Float64Array


DEFAULT_FOCAL_SIGMA = 0.25
"""Standard deviation of the logarithm of focal lengths: a phone has .7, a portrait lens 1.4 long
sides.
"""

_GRID = np.geomspace(0.45, 2.2, 24)  # focal lengths in long sides: 2.5 to 3.8 sigmas from .85
_VANISHING_POINTS = 5  # from which frames are looked for
_OFF_AXIS = np.radians(np.linspace(0, 90, 31))  # of the grid of vanishing points
_AROUND = np.radians(np.arange(1.5, 360, 3))  # the same about the optical axis
_TURNS = np.radians(np.arange(0.0, 90.0, 4.5))  # of frames about their first axis
_STARTS = 3  # frames that are refined for each focal length
_REFINEMENTS = 8
_MIN_SEGMENTS = 12

_BEND = np.radians(1.0)  # standard deviation of edges from the three directions
_END_SIGMA = 0.0016  # of a detected end point, long sides: 2 px of 1280
_OUTLIERS = 0.4  # share of segments of any direction
_ONE_LINE = (np.radians(2.0), 0.01)  # angle and long sides: closer segments lie on one line
_BY_CHANCE = 3.5  # 3.4 in 10 photos of one dome (panoptic), 4.6 in another set of it (roundtable)
# Independent observations a line. With .5 roundtable scores worse, and mirrored photos differ by
# twice as much; 30 random photos differ from their mirror images by .5 sigma (95 %).
_TEMPER = 0.25


@dataclass(frozen=True)
class _Segments:
    """Line segments in units of the long side, relative to the principal point.

    Attributes:
        middle: (M, 2).
        direction: (M, 2) unit.
        sigma: (M,) standard deviation of the direction.
        weight: (M,) 1 over the number of segments on the same line, which share its error.
    """

    middle: Float64Array
    direction: Float64Array
    sigma: Float64Array
    weight: Float64Array


def _normalised(segments: Float64Array, width: int, height: int) -> _Segments:
    """Convert segments from pixels to units of the long side."""
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    ends = (segments - centre) / max(width, height)
    middle = ends.mean(1)
    span = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(span, axis=-1)
    along = span / length[:, None]
    angle = np.abs(_cross(along[:, None], along))
    apart = np.abs(_cross(middle - middle[:, None], along[:, None]))
    same = (angle < np.sin(_ONE_LINE[0])) & (np.maximum(apart, apart.T) < _ONE_LINE[1])
    return _Segments(
        middle, along, np.hypot(_BEND, np.sqrt(2) * _END_SIGMA / length), 1 / same.sum(1)
    )


def _cross(a: Float64Array, b: Float64Array) -> Float64Array:
    """Return the cross product of vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _line_residuals(
    lines: _Segments, axes: Float64Array, focal: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return the sine of the angle from each segment to each vanishing point, and the distance to
    it, (..., K, M).

    Args:
        lines: M segments.
        axes: (..., K, 3) directions.
        focal: (...,) in long sides.
    """
    vanishing = axes * np.stack([focal, focal, np.ones_like(focal)], -1)[..., None, :]
    way = vanishing[..., None, :2] - lines.middle * vanishing[..., None, 2:]
    distance = np.linalg.norm(way, axis=-1) + 1e-12
    return _cross(way, lines.direction) / distance, distance


def _axis_odds(lines: _Segments, axes: Float64Array, focal: Float64Array) -> Float64Array:
    """Return the weighted odds (..., K, M) that a segment runs along an axis rather than
    anywhere.
    """
    sines, _ = _line_residuals(lines, axes, focal)
    density = np.exp(-((sines / lines.sigma) ** 2) / 2) / (np.sqrt(2 * np.pi) * lines.sigma)
    return np.asarray((1 - _OUTLIERS) / 3 * np.pi * density)


def _frame_log_likelihood(
    lines: _Segments, axes: Float64Array, focal: Float64Array
) -> Float64Array:
    """Return the log likelihood ratio (...,) of frames (..., 3, 3) against segments of any
    direction.
    """
    return np.asarray(np.log(_OUTLIERS + _axis_odds(lines, axes, focal).sum(-2)) @ lines.weight)


def _vanishing_points(lines: _Segments, focal: float) -> Float64Array:
    """Return directions (N, 3) along which most segments run for a focal length, each without those
    before it.
    """
    off, turn = np.meshgrid(_OFF_AXIS, _AROUND)
    x = np.sin(off) * np.cos(turn)
    y = np.sin(off) * np.sin(turn)
    directions = np.stack([x, y, np.cos(off)], -1).reshape(-1, 3)
    odds = _axis_odds(lines, directions, np.asarray(focal))
    points = []
    explained = np.ones(odds.shape[1])
    for _ in range(_VANISHING_POINTS):
        best = int((np.log1p(odds / explained) @ lines.weight).argmax())
        points.append(directions[best])
        explained = explained + odds[best]
    return np.array(points)


def _candidate_frames(lines: _Segments, focal: float, focals: Float64Array) -> Float64Array:
    """Return the best frames (F, S, 3, 3) of each focal length that have a vanishing point as an
    axis.

    Args:
        lines: of the picture.
        focal: for which directions are evenly spaced, in long sides.
        focals: (F,) in long sides.
    """
    points = _vanishing_points(lines, focal)
    # (F, N, 3)
    first = points * np.stack([focal / focals, focal / focals, np.ones_like(focals)], -1)[:, None]
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    helper = np.where(np.abs(first[..., 2:]) < 0.8, [0.0, 0.0, 1.0], [0.0, 1.0, 0.0])
    second = np.cross(first, helper)
    second /= np.linalg.norm(second, axis=-1, keepdims=True)
    third = np.cross(first, second)
    turned = (
        second[..., None, :] * np.cos(_TURNS)[:, None]
        + third[..., None, :] * np.sin(_TURNS)[:, None]
    )
    first = np.broadcast_to(first[..., None, :], turned.shape)
    axes = np.stack([first, turned, np.cross(first, turned)], -2).reshape(len(focals), -1, 3, 3)
    nats = np.array(
        [
            _frame_log_likelihood(lines, a, np.full(len(a), f))
            for a, f in zip(axes, focals, strict=True)
        ]
    )
    best = np.argsort(nats, axis=1)[:, -_STARTS:]
    return np.take_along_axis(axes, best[..., None, None], 1)


def _refine_frames(lines: _Segments, axes: Float64Array, focal: Float64Array) -> Float64Array:
    """Turn frames (..., 3, 3) to the maximum of their likelihood, by Gauss and Newton with the odds
    as weights.
    """
    from scipy.spatial.transform import Rotation

    # of a segment and the camera: its normal
    plane = np.empty((*focal.shape, len(lines.middle), 3))
    plane[..., 0] = -lines.direction[:, 1]
    plane[..., 1] = lines.direction[:, 0]
    plane[..., 2] = _cross(lines.middle, lines.direction) / focal[..., None]
    for _ in range(_REFINEMENTS):
        sines, distance = _line_residuals(lines, axes, focal)
        odds = _axis_odds(lines, axes, focal)
        weight = odds / (_OUTLIERS + odds.sum(-2, keepdims=True)) * lines.weight / lines.sigma**2
        slope = (
            np.cross(plane[..., None, :, :], axes[..., None, :])
            * (focal[..., None, None] / distance)[..., None]
        )
        matrix = np.einsum("...km,...kmi,...kmj->...ij", weight, slope, slope) + np.eye(3)
        step = np.linalg.solve(
            matrix, -np.einsum("...km,...kmi,...km->...i", weight, slope, sines)[..., None]
        )
        turn = Rotation.from_rotvec(step.reshape(-1, 3)).as_matrix().reshape(axes.shape)
        axes = axes @ turn.swapaxes(-1, -2)
    return axes


def _explained_beyond_chance(lines: _Segments, axes: Float64Array, focal: Float64Array) -> float:
    """Return how far the lines that a frame (3, 3) explains exceed chance, at most 1."""
    odds = _axis_odds(lines, axes, focal).sum(0)
    count = lines.weight.sum()
    share = float(odds / (_OUTLIERS + odds) @ lines.weight / count)
    return 1 - _BY_CHANCE**2 / float(share**2 * count)


def manhattan_frame(
    segments: Float64Array, width: int, height: int, focal_px: float
) -> tuple[Float64Array, float] | None:
    """Return the three orthogonal directions along which most straight edges run.

    Args:
        segments: (M, 2, 2) px.
        width: of the picture, px.
        height: of the picture, px.
        focal_px: focal length, px.

    Returns:
        Unit axes (3, 3) in rows, in no order and with arbitrary signs, and how far they can be
        trusted, 0 to 1; None if the segments are too few or explained no better than by chance.
    """
    if len(segments) < _MIN_SEGMENTS:
        return None
    lines = _normalised(segments, width, height)
    focal = np.array([focal_px / max(width, height)])
    starts = _candidate_frames(lines, float(focal[0]), focal)[0]
    focals = np.broadcast_to(focal, len(starts))
    axes = _refine_frames(lines, starts, focals)
    best = int(_frame_log_likelihood(lines, axes, focals).argmax())
    trust = _explained_beyond_chance(lines, axes[best], focal[0])
    return (axes[best], trust) if trust > 0 else None


def focal_of_segments(
    segments: Float64Array, width: int, height: int, default_px: float, default_sigma: float
) -> tuple[float, float] | None:
    """Estimate the focal length by a default and the segments that the best Manhattan frame of each
    length explains.

    Each segment runs along one of three orthogonal axes, with an error, or anywhere. The likelihood
    of a focal length is that of its best frame. It has less weight if the frame explains few lines
    more than frames do by chance.

    Args:
        segments: (M, 2, 2) px.
        width: of the picture, px.
        height: of the picture, px.
        default_px: focal length without segments, px.
        default_sigma: standard deviation of its logarithm.

    Returns:
        The focal length, px, a geometric mean, and the standard deviation of its logarithm; None
        when there are too few segments or they are explained no better than by chance.
    """
    from scipy.interpolate import CubicSpline

    if len(segments) < _MIN_SEGMENTS:
        return None
    lines = _normalised(segments, width, height)
    default = default_px / max(width, height)
    starts = _candidate_frames(lines, default, _GRID)
    focals = np.broadcast_to(_GRID[:, None], starts.shape[:2])
    axes = _refine_frames(lines, starts, focals)
    nats = _frame_log_likelihood(lines, axes, focals)

    best = np.unravel_index(nats.argmax(), nats.shape)
    beyond_chance = _explained_beyond_chance(lines, axes[best], focals[best])
    if beyond_chance <= 0:
        return None
    logs = np.linspace(np.log(_GRID[0]), np.log(_GRID[-1]), 10 * len(_GRID))
    log_posterior = _TEMPER * beyond_chance * CubicSpline(np.log(_GRID), nats.max(1))(logs)
    log_posterior -= ((logs - np.log(default)) / default_sigma) ** 2 / 2
    weight = np.exp(log_posterior - log_posterior.max())
    mean = float(np.average(logs, weights=weight))
    sigma = float(np.sqrt(np.average((logs - mean) ** 2, weights=weight)))
    return float(np.exp(mean)) * max(width, height), sigma
