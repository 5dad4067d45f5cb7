"""Reject a floor that contradicts the people on it. OpenCV camera frame, metres."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX, joint_pair
from physic_core.body.posture import standing_legs
from physic_core.engine.floor import MIN_UP_CONFIDENCE
from physic_core.engine.scene.solve import SceneState
from physic_core.geometry.floor import PlaneFit
from physic_core.geometry.gravity import estimate_up
from physic_core.geometry.plane import height_over_plane

FloorRejection = Literal["through_people", "far_below_people", "tilted"]
"""Reason for which people reject a floor."""

_CONFIDENCE_FACTOR = 0.5  # on the up confidence of a floor search: a tilt has little effect near the feet
_UP_AGREES = math.cos(math.radians(30.0))  # least cosine between a floor and the up direction of the scene's normals
_STANDS = math.cos(math.radians(45.0))  # least cosine between straight bodies and the camera's up axis
_STANDING_AGREES = math.cos(math.radians(40.0))  # between a floor and straight bodies, which lean on things
_CUT_M, _CUT_SHARE = 0.25, 0.1  # metres below a plane, and share of a body's vertices below that
_FAR_BELOW_M, _FAR_BELOW_SHARE = 0.8, 0.15  # metres, and share of the depth: a floor this far below is not theirs


def wrong_floor(
    floor: PlaneFit | None, vertices: Tensor, joints: Tensor, scene_normals: Tensor
) -> FloorRejection | None:
    """Return why a floor cannot be that of all people (B, V, 3) with joints (B, 55, 3), or None.

    Args:
        floor: of the scene, or None.
        vertices: of the placed bodies.
        joints: of the bodies, at any position.
        scene_normals: (M, 3) unit, zero where unknown.
    """
    if floor is None or not len(vertices):
        return None
    height = height_over_plane(vertices, floor.normal, floor.offset)
    cut = (height < -_CUT_M).to(vertices.dtype).mean(1) > _CUT_SHARE
    if floor.source != "floor mask" and bool(cut.all()):
        return "through_people"
    # The largest distance grows with the depth of the person, which is uncertain.
    if bool((height.amin(1) > _FAR_BELOW_M + _FAR_BELOW_SHARE * vertices[..., 2].mean(1)).all()):
        return "far_below_people"
    return "tilted" if _is_tilted(floor.normal, joints, scene_normals) else None


def _is_tilted(normal: Tensor, joints: Tensor, scene_normals: Tensor) -> bool:
    """Return whether the surfaces of the scene, or half of the standing people, contradict a floor's normal.

    The camera axis that points up distinguishes people who lie straight from people who stand.
    """
    estimate = estimate_up(scene_normals, normal)
    confident = estimate is not None and estimate.confidence >= _CONFIDENCE_FACTOR * MIN_UP_CONFIDENCE
    if estimate is not None and confident and float(estimate.up @ normal.to(estimate.up)) < _UP_AGREES:
        return True
    standing = standing_legs(joints.cpu().numpy()).all(1)
    axes = joints[torch.from_numpy(standing).to(joints.device)].double()
    axes = axes[:, JOINT_INDEX["neck"]] - axes[:, joint_pair("ankle")].mean(1)
    axes = torch.nn.functional.normalize(axes, dim=-1)
    cosines = (axes @ normal.to(axes))[-axes[:, 1] > _STANDS]
    return len(cosines) > 0 and float(cosines.median()) < _STANDING_AGREES


def without_floor(scene: SceneState, reason: FloorRejection) -> SceneState:
    """Return a copy of the scene without its floor, with the reason in its diagnostics."""
    diagnostics = {**scene.diagnostics, "floor": {**scene.diagnostics["floor"], "reason": reason}}
    return replace(
        scene,
        floor=None,
        floor_normal=None,
        floor_offset=0.0,
        floor_points=scene.floor_points[:0],
        diagnostics=diagnostics,
    )
