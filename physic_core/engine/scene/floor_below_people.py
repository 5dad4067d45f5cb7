"""Floor from people: reject a plane that cuts through them, and place a hidden floor under their soles.

The floor may be hidden by tables and counters, but exported scenes need a ground. Its normal is the up direction
estimated from the surfaces of the scene. Its height is that of the people's soles. OpenCV camera frame, metres.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.joint.distances import lowest_height, plane_height
from physic_core.engine.scene.build import SceneState
from physic_core.geometry.floor import FIRMNESS, PlaneFit
from physic_core.geometry.gravity import gravity

__all__ = ["floor_cuts_people", "floor_under_people", "plane_cuts_people", "without_floor"]

_UPRIGHT = math.cos(math.radians(50.0))  # cosine between up and pelvis-to-neck: lying people have no soles on the floor
_FIRMNESS_SHARE = 0.5  # of the firmness of a floor search: directly under the feet, a tilt has little effect
_APART_M = 0.2  # metres: people whose soles differ by more do not stand on one floor
_BELOW_M, _BELOW_SHARE = 0.05, 0.02  # metres, and of the distance: a point so far below the floor contradicts it
_MAX_BELOW = 0.05  # of the points
_CUT_M, _CUT_SHARE = 0.25, 0.1  # metres under a plane, and share of a body's vertices below that


def floor_under_people(
    vertices: Tensor, joints: Tensor, soles: Tensor, points: Tensor, normals: Tensor, firmness: float = FIRMNESS
) -> tuple[Tensor, float] | None:
    """The plane through the soles of upright people; None if up is unknown or scene points contradict the plane.

    Args:
        vertices: (B, V, 3); people with non-finite vertices do not count.
        joints: (B, 55, 3).
        soles: (S,) int64 vertices.
        points: (M, 3) of the scene.
        normals: (M, 3) unit, zero where unknown.
        firmness: how clearly the surfaces must show which way is up, see :class:`physic_core.geometry.gravity.Gravity`.

    Returns:
        Unit normal (3,), up, and offset: the height of X is ``normal . X + offset``.
    """
    shown = gravity(normals)
    if shown is None or shown.firmness < _FIRMNESS_SHARE * firmness:
        return None
    up = shown.up.to(vertices)
    trunk = joints[:, JOINT_INDEX["neck"]] - joints[:, JOINT_INDEX["pelvis"]]
    upright = (torch.nn.functional.normalize(trunk, dim=-1) @ up > _UPRIGHT) & torch.isfinite(vertices).flatten(1).all(
        1
    )
    if not bool(upright.any()):
        return None
    lowest = lowest_height(vertices[upright][:, soles] @ up)
    offset = -float(lowest.mean())
    below = plane_height(points, up.to(points), points.new_tensor(offset)) < -(_BELOW_M + _BELOW_SHARE * points[:, 2])
    if float(lowest.max() - lowest.min()) > _APART_M or offset <= 0 or float(below.double().mean()) > _MAX_BELOW:
        return None
    return up, offset


def floor_cuts_people(floor: PlaneFit | None, vertices: Tensor) -> bool:
    """Whether a floor cuts through all people (B, V, 3), as a table or seat does. A floor from a mask is accepted."""
    if floor is None or floor.source == "floor mask":
        return False
    return plane_cuts_people(vertices, floor.normal, floor.offset)


def without_floor(scene: SceneState) -> SceneState:
    """A copy of the scene without its floor."""
    diagnostics = {**scene.diagnostics, "floor": {**scene.diagnostics["floor"], "reason": "through_people"}}
    return replace(
        scene,
        floor=None,
        floor_normal=None,
        floor_offset=0.0,
        floor_points=scene.floor_points[:0],
        diagnostics=diagnostics,
    )


def plane_cuts_people(vertices: Tensor, normal: Tensor, offset: float) -> bool:
    """Whether a plane cuts through all people (B, V, 3); False where there are none."""
    under = plane_height(vertices, normal.to(vertices), vertices.new_tensor(offset)) < -_CUT_M
    return len(vertices) > 0 and bool((under.to(vertices.dtype).mean(1) > _CUT_SHARE).all())
