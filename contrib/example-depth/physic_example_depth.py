"""Estimate metric depth from the height of a person on the floor: single view metrology (Criminisi,
Reid, Zisserman 2000).

The floor and the pixels of a person's head and feet give the person's height in units of the
relative scene. The typical height in metres is known, and their ratio is the scale of the scene.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth, Options
from physic_core.types import DepthMap

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Bodies, Hints, Intrinsics, Plane, Pointmap


class StatureOptions(Options):
    """Settings of Stature."""

    stature_m: float = Field(
        1.68,
        gt=0.3,
        lt=2.5,
        description="height of the tallest person, m; 1.6-1.8 for adults",
    )


class Stature(MetricDepth):
    """Metric depth: the relative scene scaled by the tallest person.

    A note warns if that person does not stand.
    """

    written_for = 1
    Options = StatureOptions
    options: StatureOptions

    def infer(self, image: NDArray[np.uint8], hints: Hints) -> DepthMap:
        """Return z-depth (H, W) in metres of an image (H, W, 3); NaN where the scene has none."""
        scene = hints.scene
        original = hints.original
        people = hints.people
        if scene is None or original is None or people is None:
            raise BackendError(
                "depth by stature needs hints.scene, original and people: use it in the pipeline"
            )
        camera = scene.intrinsics or hints.intrinsics
        if camera is None:
            raise BackendError(
                "depth by stature needs a camera: choose a relative_pointmap that returns one"
            )
        heights = np.array(
            [person_height(mask, camera, original, hints.floor) for mask in people.masks]
        )
        if not np.isfinite(heights).any():
            raise BackendError(
                "depth by stature finds no person visible from head to feet: choose another backend"
            )
        tallest = int(np.nanargmax(heights))  # who sits, bends, is half hidden or a child is lower
        sure = hints.floor is not None and is_standing(hints.bodies, tallest)
        sigma, doubt = (
            (0.15, "") if sure else (0.5, ", who may well not stand on a floor: do not trust it")
        )
        depth = np.where(
            scene.valid, scene.points[..., 2] * (self.options.stature_m / heights[tallest]), np.nan
        )
        note = f"scale from a person taken to be {self.options.stature_m:g} m tall{doubt}"
        return DepthMap(depth.astype(np.float32), camera, sigma, (note,))


def is_standing(bodies: Bodies | None, person: int) -> bool:
    """Return whether hips and knees are straight and both ankles are visible; False if unknown."""
    if bodies is None or bodies.observed is None:
        return False
    bends = np.linalg.norm(bodies.parameters.body_pose[person].reshape(21, 3)[[0, 1, 3, 4]], axis=1)
    return bool((bends < 0.8).all() and bodies.observed[person, [7, 8]].all())  # radians


def person_height(
    mask: NDArray[np.bool_], camera: Intrinsics, original: Pointmap, floor: Plane | None
) -> float:
    """Return the height of a person with this mask (H, W), in units of the scene; NaN if the feet
    are not visible.
    """
    rows = np.flatnonzero(mask.any(axis=1))
    depths = original.points[mask & original.valid, 2]
    if not len(depths) or rows[-1] == len(mask) - 1:
        return float("nan")
    head, feet = (
        _ray(np.flatnonzero(mask[row]).mean(), row, camera) for row in (rows[0], rows[-1])
    )
    if floor is not None and float(floor.normal @ feet) < 0:
        up = floor.normal.astype(np.float64)
        foot = feet * floor.offset / -float(up @ feet)
    # the camera is taken to be level, and the person to be as far away as most of what is seen
    else:
        up = np.array([0.0, -1.0, 0.0])
        foot = feet * float(np.median(depths))
    # foot + h up = t head: three equations for h and t
    h, _ = np.linalg.lstsq(np.stack([up, -head], axis=1), -foot, rcond=None)[0]
    return float(h) if h > 0 else float("nan")


def _ray(u: float, v: float, camera: Intrinsics) -> NDArray[np.float64]:
    """Return the direction of a pixel with z = 1; integer pixel coordinates are pixel centres."""
    return np.array([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0])
