"""People in the picture: projected points and boxes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_bench.contract import PredictedPerson, TruePerson

    Array = NDArray[np.float64]


def person_points(person: TruePerson | PredictedPerson) -> Array:
    """Return the points (n, 3) m that show where somebody is: vertices, or else joints."""
    points = person.vertices if person.vertices is not None else person.joints
    return np.zeros((0, 3)) if points is None else np.asarray(points, np.float64)


def body_box(person: TruePerson | PredictedPerson, K: Array) -> Array | None:
    """Return the box (4,) px around a projected body; None if most of it is unknown or behind the camera."""
    return box_of_points(project(person_points(person), K))


def project(points: Array, K: Array) -> Array:
    """Return the pixels (n, 2) of points (n, 3) m of the camera frame; NaN behind the camera."""
    with np.errstate(invalid="ignore"):
        depth = np.where(points[:, 2:] > 1e-3, points[:, 2:], np.nan)
    pixels: Array = (points / depth) @ np.asarray(K, np.float64)[:2].T
    return pixels


def box_of_points(pixels: Array) -> Array | None:
    """Return the box (4,) px around the known pixels; None if most are unknown."""
    known = pixels[np.isfinite(pixels).all(-1)]
    if 2 * len(known) < len(pixels) or len(known) < 2:
        return None
    return np.concatenate([known.min(0), known.max(0)])
