"""Metric depth from the height of a person on the floor: single view metrology (Criminisi, Reid, Zisserman 2000).

The floor and two pixels, a person's head and feet, tell how high the person is in units of the relative scene. The
height in metres is known well enough, and their ratio is the scale of everything.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError, InputError
from physic_core.interfaces import MetricDepth, Options
from physic_core.types import DepthMap

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Bodies, Hints, Intrinsics, Plane

__all__ = ["Stature", "StatureOptions"]


class StatureOptions(Options):
    """Settings of Stature."""

    stature_m: float = Field(1.68, gt=0.3, lt=2.5, description="height of whoever stands, m; 1.6-1.8 for adults")


class Stature(MetricDepth):
    """Scales the relative scene by the people who stand, and says how unsure that is where nobody does."""

    Options: ClassVar[type[Options]] = StatureOptions
    options: StatureOptions

    def infer(self, image: NDArray[np.uint8], hints: Hints) -> DepthMap:
        """Image (H, W, 3) -> z-depth (H, W) in metres, NaN where the scene has none."""
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
            raise InputError(f"image must be (H, W, 3) uint8, got {image.shape} {image.dtype}")
        scene, floor, people = hints.scene, hints.floor, hints.people
        if scene is None or floor is None or people is None:
            raise BackendError("depth by stature needs scene, floor and people among the hints: use it in the pipeline")
        camera = scene.intrinsics or hints.intrinsics
        if camera is None:
            raise BackendError("depth by stature needs a camera: choose a relative_pointmap that answers one")
        heights = np.array([height(mask, camera, floor) for mask in people.masks])
        measured = np.isfinite(heights)
        if not measured.any():
            raise BackendError("depth by stature sees nobody from head to feet on the floor: choose another backend")
        upright = measured & stands(hints.bodies, len(people))
        # Who sits, bends, is half hidden or a child is lower: the tallest is nearest to a whole adult.
        tall = heights[upright if upright.any() else measured].max()
        sigma, who = (0.15, "who stands") if upright.any() else (0.5, "who may well not stand: do not trust it")
        depth = np.where(scene.valid, scene.points[..., 2] * (self.options.stature_m / tall), np.nan)
        note = f"scale from a person taken to be {self.options.stature_m:g} m tall, {who}"
        return DepthMap(depth.astype(np.float32), camera, sigma, (note,))


def stands(bodies: Bodies | None, count: int) -> NDArray[np.bool_]:
    """Which of the people (count,) have straight hips and knees, and both ankles in the photo; nobody if not known."""
    if bodies is None or bodies.observed is None:
        return np.zeros(count, bool)
    bends = np.linalg.norm(bodies.parameters.body_pose.reshape(count, 21, 3)[:, [0, 1, 3, 4]], axis=2)
    straight: NDArray[np.bool_] = (bends < 0.8).all(axis=1)  # radians
    return straight & bodies.observed[:, [7, 8]].all(axis=1)


def height(mask: NDArray[np.bool_], camera: Intrinsics, floor: Plane) -> float:
    """Height of a person with this mask (H, W) in units of the floor that they stand on; NaN if the feet are unseen."""
    rows = np.flatnonzero(mask.any(axis=1))
    if not len(rows) or rows[-1] == len(mask) - 1:
        return float("nan")
    head, feet = (_ray(np.flatnonzero(mask[row]).mean(), row, camera) for row in (rows[0], rows[-1]))
    normal = np.asarray(floor.normal, np.float64)
    down = -float(normal @ feet)
    if down <= 0:  # the feet are over the horizon
        return float("nan")
    foot = feet * floor.offset / down
    # foot + h normal = t head, three equations for h and t
    h, _ = np.linalg.lstsq(np.stack([normal, -head], axis=1), -foot, rcond=None)[0]
    return float(h) if h > 0 else float("nan")


def _ray(u: float, v: float, camera: Intrinsics) -> NDArray[np.float64]:
    """Direction of a pixel, z = 1; integer pixel coordinates are pixel centres."""
    return np.array([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0])
