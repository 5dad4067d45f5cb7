"""Metric depth from the height of a person on the floor: single view metrology (Criminisi, Reid, Zisserman 2000).

The floor and two pixels, a person's head and feet, tell how high the person is in units of the relative scene. The
height in metres is known well enough, and their ratio is the scale of everything.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth, Options
from physic_core.types import DepthMap

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Bodies, Hints, Intrinsics, Plane, Pointmap

__all__ = ["Stature", "StatureOptions"]


class StatureOptions(Options):
    """Settings of Stature."""

    stature_m: float = Field(1.68, gt=0.3, lt=2.5, description="height of whoever stands, m; 1.6-1.8 for adults")


class Stature(MetricDepth):
    """Scales the relative scene by the tallest person, and says so where that one does not stand."""

    Options: ClassVar[type[Options]] = StatureOptions
    options: StatureOptions

    def infer(self, image: NDArray[np.uint8], hints: Hints) -> DepthMap:
        """Image (H, W, 3) -> z-depth (H, W) in metres, NaN where the scene has none."""
        scene, original, people = hints.scene, hints.original, hints.people
        if scene is None or original is None or people is None:
            raise BackendError("depth by stature needs hints.scene, original and people: use it in the pipeline")
        camera = scene.intrinsics or hints.intrinsics
        if camera is None:
            raise BackendError("depth by stature needs a camera: choose a relative_pointmap that answers one")
        heights = np.array([height(mask, camera, original, hints.floor) for mask in people.masks])
        if not np.isfinite(heights).any():
            raise BackendError("depth by stature sees nobody from head to feet: choose another backend")
        tallest = int(np.nanargmax(heights))  # who sits, bends, is half hidden or a child is lower
        sure = hints.floor is not None and stands(hints.bodies, tallest)
        sigma, doubt = (0.15, "") if sure else (0.5, ", who may well not stand on a floor: do not trust it")
        depth = np.where(scene.valid, scene.points[..., 2] * (self.options.stature_m / heights[tallest]), np.nan)
        note = f"scale from a person taken to be {self.options.stature_m:g} m tall{doubt}"
        return DepthMap(depth.astype(np.float32), camera, sigma, (note,))


def stands(bodies: Bodies | None, person: int) -> bool:
    """Whether hips and knees are straight, and both ankles in the photo; False where nobody knows."""
    if bodies is None or bodies.observed is None:
        return False
    bends = np.linalg.norm(bodies.parameters.body_pose[person].reshape(21, 3)[[0, 1, 3, 4]], axis=1)
    return bool((bends < 0.8).all() and bodies.observed[person, [7, 8]].all())  # radians


def height(mask: NDArray[np.bool_], camera: Intrinsics, original: Pointmap, floor: Plane | None) -> float:
    """Height of a person with this mask (H, W), in units of the scene; NaN if the feet are unseen."""
    rows, seen = np.flatnonzero(mask.any(axis=1)), original.points[mask & original.valid, 2]
    if not len(seen) or rows[-1] == len(mask) - 1:
        return float("nan")
    head, feet = (_ray(np.flatnonzero(mask[row]).mean(), row, camera) for row in (rows[0], rows[-1]))
    if floor is not None and float(floor.normal @ feet) < 0:
        up = floor.normal.astype(np.float64)
        foot = feet * floor.offset / -float(up @ feet)
    else:  # the camera is taken to be level, and the person to be as far away as most of what is seen
        up = np.array([0.0, -1.0, 0.0])
        foot = feet * float(np.median(seen))
    # foot + h up = t head: three equations for h and t
    h, _ = np.linalg.lstsq(np.stack([up, -head], axis=1), -foot, rcond=None)[0]
    return float(h) if h > 0 else float("nan")


def _ray(u: float, v: float, camera: Intrinsics) -> NDArray[np.float64]:
    """Direction of a pixel, z = 1; integer pixel coordinates are pixel centres."""
    return np.array([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0])
