"""Estimate the disparity at infinity, the offset between a relative disparity and 1 / z.

A plane stays a plane for any disparity at infinity, so flatness cannot decide. Angles between
planes and the horizon of the floor move with it, so the cues are the three directions of a room,
upright walls, standing people, gravity from upright edges, and where the sky meets water or ground.
The prior is whether the farthest pixels are practically at infinity, as outdoors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_embedded.single_view.vertical_costs import NO_PLANES, axes_cost, frame_cost, walls_cost

if TYPE_CHECKING:
    from physic_core.types import FloatArray
    from physic_embedded.single_view.disparity_floor import DisparityFloor


# Median in ranges of the map, and sigma of its logarithm. Outdoors infinity lies below 0, where the
# network puts the sky; indoors below the farthest pixel, by .17 to 1.9 in 18 pictures of four rooms
# with people and measured geometry, and .8, 1, 1 and 2.5 in four scenes without people.
_OUTDOORS = (0.006, 0.7)
_INDOORS = (0.65, 0.85)
_CANDIDATES = (0.003, 6.0, 120)  # least and most ranges, and number
_FLOOR_SHARE = 0.1  # a smaller floor than this has no horizon worth reading
_FLAT = 0.6  # share of grounds to the horizon that are no steeper in the map nearby
_LABELS = 4.0  # log odds of outdoors where all labels are of outdoors
_HORIZON_SIGMA = 0.015  # long sides, of the seen horizon: hills, waves, and a bent floor
_STRAIGHT = 0.02  # long sides; a line that spreads more across the floor's horizon is none


@dataclass(frozen=True)
class InfinityEstimate:
    """Estimated disparity at infinity.

    Attributes:
        disparity: at infinity, in the units of the map.
        sigma: standard deviation of the logarithm of the gap from it to the farthest pixels.
        disparity_sigma: standard deviation of ``disparity``.
    """

    disparity: float
    sigma: float
    disparity_sigma: float


def disparity_at_infinity(
    disparity: FloatArray,
    floor: DisparityFloor | None,
    focal_px: float,
    *,
    pitch: tuple[float, float] | None = None,
    focal_sigma: float = 0.0,
    walls: FloatArray = NO_PLANES,
    bodies: FloatArray = NO_PLANES,
    frame: tuple[FloatArray, float] | None = None,
    surfaces: FloatArray = NO_PLANES,
    open_air: float = 0.0,
    horizon: FloatArray | None = None,
) -> InfinityEstimate:
    """Estimate the disparity at infinity of a disparity map: the mean of its logarithm below the
    farthest pixels.

    Args:
        disparity: (H, W), larger is nearer; the network answers 0 for the sky.
        floor: of the same map, or None.
        focal_px: focal length at the resolution of ``disparity``, px.
        pitch: how far the camera looks down by upright edges and its standard deviation, degrees.
        focal_sigma: standard deviation of the logarithm of the focal length; 0 if it is known.
        walls: (M, 3) local planes of walls, see
            :func:`~physic_embedded.single_view.vertical_costs.local_disparity_planes`.
        bodies: (N, 3) planes of standing people, see
            :func:`~physic_embedded.single_view.vertical_costs.body_planes`.
        frame: directions of a room and their trust, see
            :func:`~physic_embedded.single_view.focal.manhattan_frame`, or None.
        surfaces: (M, 3) local planes of everything, like ``walls``; looked at with ``frame``.
        open_air: -1 to 1, whether the labels of surfaces are of rooms or of outdoors.
        horizon: (M, 2) where the sky meets water or ground, px of the map.
    """
    focal = focal_px / max(disparity.shape)
    low, farthest, high = map(float, np.percentile(disparity, [1, 0.5, 99]))
    span = max(high - low, 1e-6)
    outdoors = _outdoor_probability(farthest / span, floor, open_air)
    gaps = np.geomspace(*_CANDIDATES)
    candidates = farthest - gaps * span
    level: FloatArray = np.zeros(len(gaps))
    trust = 0.0
    if floor is not None and horizon is not None:
        level, trust = _horizon_cost(floor, candidates, horizon, disparity.shape)
    sky = outdoors * (1 - (1 - _FLAT) * trust)
    cost = _sky_gap_cost(gaps, sky, max(farthest, 0.0) / span) + level
    if floor is not None and floor.inlier_share > _FLOOR_SHARE:
        cost = cost + _floor_cost(
            floor, candidates, (focal, focal_sigma), pitch=pitch, walls=walls, bodies=bodies
        )
    if frame is not None and len(surfaces):
        axes, trust = frame
        cost = cost + trust * frame_cost(surfaces, candidates, axes)
    weight = np.exp(-(cost - cost.min()) / 2)
    gap = float(np.exp(np.average(np.log(gaps), weights=weight)))
    infinity = farthest - gap * span
    sigma = _weighted_std(np.log(gaps), np.log(gap), weight)
    return InfinityEstimate(infinity, sigma, _weighted_std(candidates, infinity, weight))


def _weighted_std(values: FloatArray, mean: float, weight: FloatArray) -> float:
    """Return the standard deviation of weighted values (C,)."""
    return float(np.sqrt(np.average((values - mean) ** 2, weights=weight)))


def _outdoor_probability(farthest: float, floor: DisparityFloor | None, open_air: float) -> float:
    """Return the probability of outdoors by the disparity of the farthest pixels in ranges of the
    map, the share of the floor, and the labels, -1 to 1.

    Outdoors the network saturates at 0, and the ground fills the lower part: read off 20 photos.
    With labels, the mean log score of 54 others is -.19 in place of -.42.
    """
    share = 0.0 if floor is None else floor.inlier_share
    odds = (
        (0.014 - farthest) / 0.004 + float(np.clip((share - 0.3) / 0.1, -2, 2)) + _LABELS * open_air
    )
    return float(1 / (1 + np.exp(-np.clip(odds, -30, 30))))


def _sky_gap_cost(gaps: FloatArray, sky: float, sky_disparity: float) -> FloatArray:
    """Return the cost (C,) of gaps from infinity to the farthest pixels, which are sky of a
    disparity, in ranges of the map, with probability ``sky``.
    """

    def prior(median: float, sigma: float) -> FloatArray:
        return np.asarray(np.exp(-0.5 * (np.log(gaps / median) / sigma) ** 2))

    outdoors = prior(_OUTDOORS[0] + sky_disparity, _OUTDOORS[1])
    return np.asarray(-2 * np.log(sky * outdoors + (1 - sky) * prior(*_INDOORS) + 1e-6))


def _floor_cost(
    floor: DisparityFloor,
    candidates: FloatArray,
    focal: tuple[float, float],
    *,
    pitch: tuple[float, float] | None,
    walls: FloatArray,
    bodies: FloatArray,
) -> FloatArray:
    """Return the cost (C,) of the floor's tilt for candidates (C,) of the disparity at infinity.

    ``focal`` is the focal length in long sides, and the standard deviation of its logarithm, which
    turns the floor.
    """
    down = np.array([floor.normal(c, focal[0]) for c in candidates])
    cost = np.zeros(len(candidates))
    if pitch is not None:
        from physic_core.geometry import FOCAL_PITCH_DEG

        sigma = math.hypot(pitch[1], FOCAL_PITCH_DEG * focal[1])
        of_floor = np.degrees(np.arctan2(down[:, 2], down[:, 1]))
        cost = cost + _robust_cost((of_floor - pitch[0]) / sigma)
    if len(walls):
        cost = cost + walls_cost(walls, candidates, down)
    if len(bodies):
        cost = cost + axes_cost(bodies, down)
    return cost


def _horizon_cost(
    floor: DisparityFloor, candidates: FloatArray, horizon: FloatArray, shape: tuple[int, ...]
) -> tuple[FloatArray, float]:
    """Return the cost (C,) of candidates, since at its horizon (M, 2), px, the floor is infinitely
    far, and the trust in that line, 0 to 1.
    """
    rays = (horizon - (np.array(shape[1::-1]) - 1) / 2) / max(shape)
    far = rays @ np.array([floor.du, floor.dv]) + floor.d0
    middle = float(np.median(far))
    spread = 1.48 * float(np.median(np.abs(far - middle)))
    trust = float(np.exp(-0.5 * (spread / (_STRAIGHT * floor.dv)) ** 2))
    cost = _robust_cost((candidates - middle) / np.hypot(spread, _HORIZON_SIGMA * floor.dv))
    return trust * cost, trust


def _robust_cost(residual: FloatArray) -> FloatArray:
    """Return a robust squared residual, so that a single wrong cue cannot outweigh the others."""

    return 4 * np.log1p(residual**2 / 4)
