"""Named points of a body, and the joint sets of 2D and 3D pose networks as lists of them.

A point is a joint of the model, or the mean of a few picked surface vertices. Left is always the body's own left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX, NUM_JOINTS, SIDES

if TYPE_CHECKING:
    from physic_core.types import Keypoints

__all__ = [
    "DETECTED",
    "SKELETONS",
    "SURFACE_POINTS",
    "PointRegressor",
    "known_keypoints",
    "known_part",
    "skeleton_regressor",
]

_FACE = ("eye", "ear", "eye_inner", "eye_outer", "mouth_corner")
_HAND = ("thumb_tip", "index_tip", "middle_tip", "ring_tip", "pinky_tip")
_FOOT = ("big_toe", "small_toe", "heel", "foot_tip")

SURFACE_POINTS: tuple[str, ...] = (
    "nose",
    *(f"{side}_{name}_surface" for name in _FACE for side in SIDES),
    *(f"{side}_{name}" for name in (*_HAND, *_FOOT) for side in SIDES),
)
"""Points that are picked on the mesh: left and right of each, the nose once."""


def _both(*names: str, suffix: str = "") -> tuple[str, ...]:
    return tuple(f"{side}_{name}{suffix}" for name in names for side in SIDES)


def _hand(side: str) -> tuple[str, ...]:
    thumb = (f"{side}_thumb1", f"{side}_thumb2", f"{side}_thumb3", f"{side}_thumb_tip")
    fingers = (
        name
        for finger in ("index", "middle", "ring", "pinky")
        for name in (*(f"{side}_{finger}{k}" for k in (1, 2, 3)), f"{side}_{finger}_tip")
    )
    return (f"{side}_wrist", *thumb, *fingers)


_COCO17 = (
    "nose",
    *_both("eye", "ear", suffix="_surface"),
    *_both("shoulder", "elbow", "wrist", "hip", "knee", "ankle"),
)

_COCO23 = (*_COCO17, *(f"{side}_{name}" for side in SIDES for name in ("big_toe", "small_toe", "heel")))
_FACE_POINTS = {
    36: "right_eye_outer_surface",
    39: "right_eye_inner_surface",
    42: "left_eye_inner_surface",
    45: "left_eye_outer_surface",
    48: "right_mouth_corner_surface",
    54: "left_mouth_corner_surface",
}
"""Which of the 68 points of a face a body has; contour, brows, nose and lips it has not."""
_WHOLE_FACE = tuple(_FACE_POINTS.get(i, f"face_point_{i}") for i in range(68))

SKELETONS: dict[str, tuple[str, ...]] = {
    "coco17": _COCO17,
    "coco23": _COCO23,
    "blazepose33": (
        "nose",
        *(f"{side}_{name}_surface" for side in SIDES for name in ("eye_inner", "eye", "eye_outer")),
        *_both("ear", "mouth_corner", suffix="_surface"),
        *_both("shoulder", "elbow", "wrist", "pinky1", "index1", "thumb2", "hip", "knee", "ankle", "heel", "foot_tip"),
    ),
    "openpose_hand21_left": _hand("left"),
    "openpose_hand21_right": _hand("right"),
    "wholebody69": (*_COCO23, *_FACE_POINTS.values(), *_hand("left")[1:], *_hand("right")[1:]),
}
"""Joint set -> its points in order. "coco23" is COCO-17 and the six foot points of COCO-WholeBody; the hand sets are
wrist, thumb, index, middle, ring, pinky, each from its base to its tip, as MediaPipe orders them too. "wholebody69" is
what bodies have of COCO-WholeBody's 133."""

DETECTED: dict[str, tuple[str, ...]] = {
    **SKELETONS,
    "coco_wholebody133": (
        *_COCO23,
        *_WHOLE_FACE,
        *(name for side in SIDES for name in (f"{side}_hand_root", *_hand(side)[1:])),
    ),
    "halpe26": (
        *_COCO17,
        *("head_top", "neck_base", "hips_middle"),
        *_both("big_toe", "small_toe", "heel"),
    ),
}
"""Joint set that a detector may answer -> its points in order, of which bodies need not have all. Whole-body networks
mark both wrists twice, as the arm's end and as the hand's root; only the first is a point of a body."""

_KNOWN_PART = {"coco_wholebody133": "wholebody69", "halpe26": "coco23"}


def known_part(skeleton: str) -> tuple[str, list[int]]:
    """The part of a joint set that bodies have.

    Args:
        skeleton: a key of DETECTED.

    Returns:
        A key of SKELETONS, and which of the detector's points are its points, in its order.
    """
    known = _KNOWN_PART.get(skeleton, skeleton)
    row = {name: i for i, name in enumerate(DETECTED[skeleton])}
    return known, [row[name] for name in SKELETONS[known]]


def known_keypoints(keypoints: Keypoints) -> Keypoints:
    """The keypoints that bodies have; those of a joint set that is all of it, or that nobody knows, as they are."""
    if keypoints.skeleton not in _KNOWN_PART:
        return keypoints
    known, columns = known_part(keypoints.skeleton)
    return replace(
        keypoints,
        points=keypoints.points[:, columns],
        confidence=keypoints.confidence[:, columns],
        skeleton=known,
        world=None if keypoints.world is None else keypoints.world[:, columns],
    )


_MARKS: dict[str, tuple[tuple[str, str, float], ...]] = {
    "blazepose33": (
        ("hip", "knee", 0.06),
        ("hip", "~hip", 0.08),
        ("ankle", "knee", 0.10),
        ("shoulder", "~shoulder", 0.055),
        ("shoulder", "hip", -0.055),
        ("heel", "ankle", 0.16),
        ("foot_tip", "heel", 0.085),
        ("foot_tip", "ankle", 0.26),
        ("ear_surface", "nose", 0.14),
        ("eye_surface", "nose", 0.05),
        ("pinky1", "wrist", 0.23),
        ("index1", "wrist", 0.21),
        ("thumb2", "wrist", 0.12),
    ),
}
"""Where a network puts its marks beside the points of the same name: point, the point towards which the mark lies ("~":
the same of the other side), by which share of the way. Measured by fitting the embedded body to 31 people in 16 photos
with these shares left free; shares of one half of the photos lower the reprojection error on the other by a fifth."""


@dataclass(frozen=True)
class PointRegressor:
    """A linear map from joints and a few vertices to named points.

    Attributes:
        vertex_ids: (n,) int64, the vertices that it reads.
        matrix: (J, 55 + n): each row sums to 1.
    """

    vertex_ids: Tensor
    matrix: Tensor

    def __call__(self, joints: Tensor, vertices: Tensor) -> Tensor:
        """Joints (B, 55, 3) and the n vertices (B, n, 3) -> points (B, J, 3)."""
        return self.matrix @ torch.cat([joints, vertices], 1)

    def to(self, device: torch.device | str | None, dtype: torch.dtype | None) -> PointRegressor:
        """The same on another device, or in another float type."""
        return PointRegressor(self.vertex_ids.to(device=device), self.matrix.to(device=device, dtype=dtype))


def skeleton_regressor(skeleton: str, picks: Mapping[str, Tensor], like: Tensor) -> PointRegressor:
    """The map to one joint set.

    Args:
        skeleton: a key of SKELETONS.
        picks: surface point -> vertex ids.
        like: gives the float type and the device.
    """
    points = _regressor(SKELETONS[skeleton], picks, like)
    return replace(points, matrix=_marks(skeleton).to(like) @ points.matrix)


def _marks(skeleton: str) -> Tensor:
    """(J, J), rows that sum to 1: the marks of a network from the points of the same names."""
    row = {name: i for i, name in enumerate(SKELETONS[skeleton])}
    blend = torch.eye(len(row))
    for side, other in zip(SIDES, reversed(SIDES), strict=True):
        for point, towards, share in _MARKS.get(skeleton, ()):
            start = row[f"{side}_{point}"]
            end = towards if towards in row else f"{other}_{towards[1:]}" if towards[0] == "~" else f"{side}_{towards}"
            blend[start, start] -= share
            blend[start, row[end]] += share
    return blend


def _regressor(names: Sequence[str], picks: Mapping[str, Tensor], like: Tensor) -> PointRegressor:
    surface = [name for name in names if name not in JOINT_INDEX]
    groups = [picks[name] for name in surface]
    ids = torch.cat(groups) if groups else torch.zeros(0, dtype=torch.int64)
    matrix = torch.zeros(len(names), NUM_JOINTS + len(ids), dtype=like.dtype)
    start = NUM_JOINTS
    for row, name in enumerate(names):
        if name in JOINT_INDEX:
            matrix[row, JOINT_INDEX[name]] = 1.0
        else:
            count = len(picks[name])
            matrix[row, start : start + count] = 1.0 / count
            start += count
    return PointRegressor(ids.to(like.device), matrix.to(like.device))
