"""Metric depth of a scene whose scale the photo does not determine: a guess, marked as one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.engine.sizes.evidence import USUAL_CAMERA_HEIGHT_M, USUAL_DEPTH_M
from physic_core.types import DepthMap

if TYPE_CHECKING:
    from physic_core.types import Intrinsics, Plane, Pointmap


def guess_metric_depth(scene: Pointmap, floor: Plane | None, camera: Intrinsics) -> tuple[DepthMap, str]:
    """Scale the relative depth of a scene to a typical size, and return it with a warning that names the assumption.

    Args:
        scene: relative point map of the photo without people.
        floor: in the units of ``scene``, or None.
        camera: of the point map, if it does not have its own.

    Returns:
        Depth (H, W) metres with ``scale_sigma`` None, and the warning.
    """
    depth = np.where(scene.valid, scene.points[..., 2], np.nan)
    if floor is not None and floor.offset > 0:
        scale = USUAL_CAMERA_HEIGHT_M / floor.offset
        assumed = f"the camera is assumed to be {USUAL_CAMERA_HEIGHT_M:g} m above the floor"
    else:
        scale = USUAL_DEPTH_M / float(np.nanmedian(depth))
        assumed = f"the median depth is assumed to be {USUAL_DEPTH_M:g} m"
    metric = DepthMap((depth * scale).astype(np.float32), scene.intrinsics or camera)
    return (
        metric,
        f"the scale is unknown without a person: {assumed}; use a metric depth network to get metres",
    )
