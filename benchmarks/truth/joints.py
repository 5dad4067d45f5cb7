"""The 12 limb joints that bodies and all data sets share: names, root, bone lengths, and who is
upright.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.scoring import LIMB_JOINTS
from physic_core.body.joints import JOINT_INDEX
from physic_core.body.posture import legs_in_line
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

BODY_ROWS = [JOINT_INDEX[name] for name in LIMB_JOINTS]
"""Their rows in the 55 joints of every body model here."""

ROW = {name: i for i, name in enumerate(LIMB_JOINTS)}
HIPS = [ROW["left_hip"], ROW["right_hip"]]
SHOULDERS = [ROW["left_shoulder"], ROW["right_shoulder"]]

BONES: dict[str, tuple[tuple[int, int], ...]] = {
    name: tuple((ROW[f"{side}_{upper}"], ROW[f"{side}_{lower}"]) for side in SIDES)
    for name, upper, lower in (
        ("upper_arm", "shoulder", "elbow"),
        ("forearm", "elbow", "wrist"),
        ("thigh", "hip", "knee"),
        ("shank", "knee", "ankle"),
    )
}
"""Bones between joints of nearly one definition in all data sets; the widths of hips and shoulders
are not.
"""


def limb_joints(named: Mapping[str, Sequence[float]], size: int) -> Array:
    """(12, size) of named points, NaN where one is missing; "l_knee" is "left_knee"."""
    sides = {"l_": "left_", "r_": "right_"}
    points = {sides.get(name[:2], name[:2]) + name[2:]: point for name, point in named.items()}
    missing = [float("nan")] * size
    return np.array([list(points.get(name, missing))[:size] for name in LIMB_JOINTS], np.float64)


def root(joints: Array, is_known: NDArray[np.bool_] | None = None) -> Array:
    """(3,) the middle of the hips, of the known ones alone: the pelvis itself is placed differently
    by data sets.
    """
    hips = [row for row in HIPS if is_known is None or is_known[row]]
    middle: Array = joints[hips].mean(0) if hips else np.full(3, np.nan)
    return middle


def bone_lengths(joints: Array) -> dict[str, Any]:
    """Length of each kind of bone of (12, 3) joints, the mean of both sides; NaN where neither is
    known.
    """
    lengths = {}
    for name, pairs in BONES.items():
        sides = np.array([np.linalg.norm(joints[a] - joints[b]) for a, b in pairs])
        lengths[name] = (
            float(np.mean(sides[np.isfinite(sides)])) if np.isfinite(sides).any() else float("nan")
        )
    return lengths


def is_upright(joints: Array, up: Array | None) -> bool | None:
    """Whether somebody stands, on one leg at least; None where joints are missing that decide it.

    Args:
        joints: (12, 3) m; NaN where unknown.
        up: (3,) unit, or None where unknown: then the angles of the limbs decide alone.
    """
    hips, knees, ankles = (
        joints[[ROW[f"{side}_{name}"] for side in SIDES]] for name in ("hip", "knee", "ankle")
    )
    shoulders = joints[SHOULDERS]
    neck = (
        shoulders[np.isfinite(shoulders).all(-1)].mean(0)
        if np.isfinite(shoulders).all(-1).any()
        else shoulders[0]
    )
    if legs_in_line(hips, knees, ankles, neck=neck, up=up).any():
        return True
    return False if np.isfinite([*hips, *knees, *ankles, neck]).all() else None
