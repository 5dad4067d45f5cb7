"""Errors of the scene: depth, points, scale and floor.

Metres, OpenCV camera frame (x right, y down, z forward); depth is along z. No alignment: the scene is metric.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.metrics.shapes import require_same_shape

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Plane

_DELTA = 1.25
"""Largest depth ratio of a correct pixel (Eigen et al., NeurIPS 2014)."""


@dataclass(frozen=True)
class SceneError:
    """Errors over the pixels that are valid in both point maps; NaN without such pixels.

    Attributes:
        pixels: number of these pixels.
        coverage: their share of the truly valid pixels.
        depth_relative_median: median of ``|Z - Z*| / Z*``.
        depth_relative_mean: mean of the same.
        delta_share: share of pixels with max(Z / Z*, Z* / Z) < 1.25.
        point_median: median distance of the points, m.
        point_mean: mean distance of the points, m.
        log_scale: ln of the median depth over the true median depth: 0.1 is a scene about 10 % too large.
    """

    pixels: int
    coverage: float
    depth_relative_median: float
    depth_relative_mean: float
    delta_share: float
    point_median: float
    point_mean: float
    log_scale: float


@dataclass(frozen=True)
class FloorError:
    """Errors of a floor plane; NaN if no floor was found.

    Attributes:
        angle_deg: between the normals, in [0, 180].
        height: metres by which the found floor is too low.
    """

    angle_deg: float
    height: float


def scene_error(
    predicted: FloatArray, truth: FloatArray, predicted_valid: BoolArray, true_valid: BoolArray
) -> SceneError:
    """Compare two point maps pixel by pixel.

    Args:
        predicted: (H, W, 3) m, or any leading shape that ``truth`` has too.
        truth: (H, W, 3) m.
        predicted_valid: (H, W) bool; points that are not finite or have no positive depth are invalid too.
        true_valid: (H, W) bool, likewise.

    Raises:
        PhysicError: the shapes differ.
    """
    require_same_shape("point maps", predicted, truth)
    require_same_shape("masks of valid pixels", predicted_valid, true_valid)
    known = _valid(truth, true_valid)
    both = known & _valid(predicted, predicted_valid)
    pixels = int(both.sum())
    if not pixels:
        return SceneError(0, 0.0 if known.any() else math.nan, *[math.nan] * 6)
    points, facts = (np.asarray(array[both], np.float64) for array in (predicted, truth))
    depth, fact = points[:, 2], facts[:, 2]
    relative = np.abs(depth - fact) / fact
    off = np.linalg.norm(points - facts, axis=1)
    return SceneError(
        pixels=pixels,
        coverage=pixels / int(known.sum()),
        depth_relative_median=float(np.median(relative)),
        depth_relative_mean=float(relative.mean()),
        delta_share=float((np.maximum(depth / fact, fact / depth) < _DELTA).mean()),
        point_median=float(np.median(off)),
        point_mean=float(off.mean()),
        log_scale=math.log(float(np.median(depth)) / float(np.median(fact))),
    )


def floor_error(predicted: Plane | None, truth: Plane, at: FloatArray | None = None) -> FloorError:
    """Compare two floor planes.

    Args:
        predicted: found plane, or None.
        truth: true plane.
        at: (3,) m, position at which heights are compared, such as a person's feet; the camera if None. A tilted floor
            has another error at another position.
    """
    if predicted is None:
        return FloorError(math.nan, math.nan)
    place = np.zeros(3) if at is None else np.asarray(at, np.float64)
    found, fact = (np.asarray(plane.normal, np.float64) for plane in (predicted, truth))
    # The arc tangent is accurate for small angles, unlike the arc cosine.
    angle = math.atan2(float(np.linalg.norm(np.cross(found, fact))), float(found @ fact))
    height = (found @ place + predicted.offset) - (fact @ place + truth.offset)
    return FloorError(math.degrees(angle), float(height))


def _valid(points: FloatArray, valid: BoolArray) -> BoolArray:
    answer: BoolArray = valid & np.isfinite(points).all(-1) & (points[..., 2] > 0)
    return answer
