"""Keypoints of a skeleton as linear functions of a body's joints and vertices.

Each keypoint is a joint of the model, or the mean of a few surface vertices. Left is always the body's own left.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX, JOINT_NAMES, NUM_JOINTS
from physic_core.errors import BodyModelError
from physic_core.types import Keypoints
from physic_core.types.skeletons import SIDES, Skeleton

_FACE = ("eye", "ear", "eye_inner", "eye_outer", "mouth_corner")
_HAND = ("thumb_tip", "index_tip", "middle_tip", "ring_tip", "pinky_tip")
_FOOT = ("big_toe", "small_toe", "heel", "foot_tip")

SURFACE_POINTS: tuple[str, ...] = (
    "nose",
    *(f"{side}_{name}_surface" for name in _FACE for side in SIDES),
    *(f"{side}_{name}" for name in (*_HAND, *_FOOT) for side in SIDES),
)
"""Names of landmarks on the mesh: the nose, and left and right of all others."""

BODY_POINTS: tuple[str, ...] = (*JOINT_NAMES, *SURFACE_POINTS)
"""Names of all points that a :class:`~physic_core.types.skeletons.Skeleton` can refer to."""


def keypoints_on_body(keypoints: Keypoints) -> Keypoints:
    """Remove the keypoints whose position on a body model is not defined by the skeleton."""
    skeleton = keypoints.joint_set
    if len(skeleton.fitted) == len(skeleton):
        return keypoints
    return keypoints.take(skeleton.fitted)


_SHARES_OFF = 1e-6


@dataclass(frozen=True)
class LandmarkRegressor:
    """Linear map from joints and a few vertices to named points.

    Attributes:
        vertex_ids: (n,) int64, input vertices.
        matrix: (J, 55 + n): each row sums to 1.
    """

    vertex_ids: Tensor
    matrix: Tensor

    def __call__(self, joints: Tensor, vertices: Tensor) -> Tensor:
        """Map joints (B, 55, 3) and the n vertices (B, n, 3) to points (B, J, 3)."""
        return self.matrix @ torch.cat([joints, vertices], 1)


def skeleton_regressor(skeleton: Skeleton, picks: Mapping[str, Tensor]) -> LandmarkRegressor:
    """Build the linear map from a body to the keypoints of a skeleton, float32 on the CPU.

    Args:
        skeleton: all of its points must be defined on a body, see ``Skeleton.fitted``.
        picks: name in SURFACE_POINTS -> vertex ids.

    Raises:
        BodyModelError: a point is not defined on a body, or refers to an unknown point.
    """
    blend, names = _blend(skeleton)
    points = _regressor(names, picks)
    return replace(points, matrix=blend @ points.matrix)


def _blend(skeleton: Skeleton) -> tuple[Tensor, list[str]]:
    """Return the (J, P) weights of P body points for each keypoint, with rows that sum to 1, and the P names."""
    used = [other for blend in skeleton.on_body.values() for other in blend]
    names = list(dict.fromkeys(name for name in (*skeleton.names, *used) if name in BODY_POINTS))
    column = {name: i for i, name in enumerate(names)}
    blend = torch.zeros(len(skeleton), len(names))
    for row, name in enumerate(skeleton.names):
        shares = skeleton.on_body.get(name, {})
        _check_place(skeleton.name, name, shares)
        if name in column:
            blend[row, column[name]] = 1
        for other, share in shares.items():
            blend[row, column[other]] += share
            if name in column:
                blend[row, column[name]] -= share
    return blend, names


def _check_place(skeleton: str, name: str, shares: Mapping[str, float]) -> None:
    """Raise BodyModelError if a keypoint has no valid definition on the body."""
    if strange := [other for other in shares if other not in BODY_POINTS]:
        raise BodyModelError(
            f"the point {name!r} of the skeleton {skeleton!r} refers to {', '.join(strange)}, which no body has: "
            f"choose among {', '.join(BODY_POINTS)}"
        )
    if name not in BODY_POINTS and abs(sum(shares.values()) - 1) > _SHARES_OFF:
        raise BodyModelError(
            f"the point {name!r} of the skeleton {skeleton!r} is not a point of a body, and its shares of body points "
            f"sum to {sum(shares.values()):g}, not 1: state in Skeleton.on_body where it lies, or {{}} for nowhere"
        )


def _regressor(names: list[str], picks: Mapping[str, Tensor]) -> LandmarkRegressor:
    """Return the map from joints and n vertices to the named body points, matrix (P, 55 + n)."""
    groups = [picks[name].cpu() for name in names if name not in JOINT_INDEX]
    ids = torch.cat(groups) if groups else torch.zeros(0, dtype=torch.int64)
    matrix = torch.zeros(len(names), NUM_JOINTS + len(ids))
    start = NUM_JOINTS
    for row, name in enumerate(names):
        if name in JOINT_INDEX:
            matrix[row, JOINT_INDEX[name]] = 1.0
        else:
            count = len(picks[name])
            matrix[row, start : start + count] = 1.0 / count
            start += count
    return LandmarkRegressor(ids, matrix)
