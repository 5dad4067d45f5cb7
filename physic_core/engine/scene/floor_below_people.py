"""A floor that the photo does not show, put under the people who stand or sit upright on it.

Behind tables and counters there is a floor all the same, and what is exported needs a ground. Its up is what the
surfaces of the scene tell, its height that of the people's soles. Metres, camera frame.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.joint.terms import lowest_height, plane_height
from physic_core.geometry.gravity import gravity

__all__ = ["cuts_people", "floor_under_people"]

_UPRIGHT = math.cos(math.radians(50.0))  # of pelvis to neck with up: who lies has no soles on the floor
_FIRMNESS_SHARE = 0.5  # of what a search for the floor asks for: under the feet themselves a tilt hardly matters
_APART_M = 0.2  # people whose soles differ by more do not stand on one floor
_BELOW_M, _BELOW_SHARE = 0.05, 0.02  # metres, and of the distance: a point so far below the floor denies it
_MOST_BELOW = 0.05  # of the points
_CUT_M, _CUT_SHARE = 0.25, 0.1  # so deep under a plane, and so much of a body


def floor_under_people(
    vertices: Tensor, joints: Tensor, soles: Tensor, points: Tensor, normals: Tensor, firmness: float
) -> tuple[Tensor, float] | None:
    """The plane through the soles of upright people; None where up is not known or something denies it.

    Args:
        vertices: (B, V, 3); people who are not finite do not count.
        joints: (B, 55, 3).
        soles: (S,) int64 vertices.
        points: (M, 3) of the scene.
        normals: (M, 3) unit, zero where unknown.
        firmness: how clearly the surfaces must tell which way is up, see :class:`physic_core.geometry.gravity.Gravity`.

    Returns:
        Unit normal (3,), up, and offset: the height of X is ``normal . X + offset``.
    """
    told = gravity(normals)
    if told is None or told.firmness < _FIRMNESS_SHARE * firmness:
        return None
    up = told.up.to(vertices)
    trunk = (
        torch.nn.functional.normalize(joints[:, JOINT_INDEX["neck"]] - joints[:, JOINT_INDEX["pelvis"]], dim=-1) @ up
    )
    upright = (trunk > _UPRIGHT) & torch.isfinite(vertices).flatten(1).all(1)
    if not bool(upright.any()):
        return None
    lowest = lowest_height(vertices[upright][:, soles] @ up)
    offset = -float(lowest.mean())
    below = plane_height(points, up.to(points), points.new_tensor(offset)) < -(_BELOW_M + _BELOW_SHARE * points[:, 2])
    if float(lowest.max() - lowest.min()) > _APART_M or offset <= 0 or float(below.double().mean()) > _MOST_BELOW:
        return None
    return up, offset


def cuts_people(vertices: Tensor, normal: Tensor, offset: float) -> bool:
    """Whether a plane goes through everybody (B, V, 3), as that of a table or a seat does; False for nobody."""
    under = plane_height(vertices, normal.to(vertices), vertices.new_tensor(offset)) < -_CUT_M
    return len(vertices) > 0 and bool((under.to(vertices.dtype).mean(1) > _CUT_SHARE).all())
