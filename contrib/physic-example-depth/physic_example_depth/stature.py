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

    from physic_core.types import Hints, Intrinsics, Plane

__all__ = ["Stature", "StatureOptions"]


class StatureOptions(Options):
    """Settings of Stature."""

    stature_m: float = Field(1.68, gt=0.3, lt=2.5, description="height of the tallest person, m; 1.6-1.8 for adults")
    scale_sigma: float = Field(0.2, gt=0, lt=3, description="how unsure the scale is, log standard deviation")


class Stature(MetricDepth):
    """Scales the relative scene by the tallest person: who sits or bends is lower, and does not count."""

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
        heights = [height(mask, camera, floor) for mask in people.masks]
        if not np.isfinite(heights).any():
            raise BackendError("depth by stature sees nobody from head to feet on the floor: choose another backend")
        scale = self.options.stature_m / np.nanmax(heights)
        depth = np.where(scene.valid, scene.points[..., 2] * scale, np.nan).astype(np.float32)
        note = f"scale from a person who is taken to be {self.options.stature_m:g} m tall"
        return DepthMap(depth, camera, self.options.scale_sigma, (note,))


def height(mask: NDArray[np.bool_], camera: Intrinsics, floor: Plane) -> float:
    """Height of a person with this mask (H, W) over the floor that they stand on, in its units; NaN if feet are unseen."""
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
