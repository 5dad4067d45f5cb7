"""Which part of the body a vertex belongs to, and which vertex sets usually touch the world.

Parts come from skinning weights, contact sets from the geometry of the T-pose (after the idea of PROX: feet, thighs,
gluteus, back, hands). Both work for any mesh in SMPL-X layout.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physic_core.body.joints import JOINT_INDEX, JOINT_NAMES, SIDES
from physic_core.body.rest_mesh import RestMesh

__all__ = ["CONTACT_SETS", "PART_NAMES", "contact_sets", "label_parts"]

_LIMBS = ("upper_arm", "lower_arm", "hand", "upper_leg", "lower_leg", "foot")

PART_NAMES: tuple[str, ...] = ("torso", "head", *(f"{side}_{limb}" for limb in _LIMBS for side in SIDES))
"""The trunk with the pelvis, the head with the neck, and six parts a side."""

CONTACT_SETS: tuple[str, ...] = (
    *(f"{side}_{name}" for name in ("sole", "foot", "hand") for side in SIDES),
    "thighs",
    "gluteus",
    "back",
)
"""Names of the vertex sets: soles and their rims, soles with the lower half of the feet, palms and fingers, undersides
of the thighs, seat, back."""

_SOLE_DEPTH = 0.02
"""Metres over the lowest point of a foot that still count as its sole, where the surface faces down."""
_FOOT_DEPTH = 0.045
"""Metres over the lowest point of a foot that count as its lower half."""


def _part_of_joint(name: str) -> str:
    side, _, rest = name.partition("_")
    limb = {
        "hip": "upper_leg",
        "knee": "lower_leg",
        "ankle": "foot",
        "foot": "foot",
        "shoulder": "upper_arm",
        "elbow": "lower_arm",
        "wrist": "hand",
    }.get(rest, "hand" if rest[-1:].isdigit() else "")
    if limb:
        return f"{side}_{limb}"
    return "head" if name in ("neck", "head", "jaw", "left_eye", "right_eye") else "torso"


def label_parts(weights: NDArray[np.float64]) -> NDArray[np.int64]:
    """Skinning weights (V, 55) -> the part of each vertex (V,), an index into PART_NAMES: the one with most weight."""
    member = np.zeros((len(JOINT_NAMES), len(PART_NAMES)))
    for joint, name in enumerate(JOINT_NAMES):
        member[joint, PART_NAMES.index(_part_of_joint(name))] = 1.0
    labels: NDArray[np.int64] = np.argmax(weights @ member, axis=1)
    return labels


def contact_sets(mesh: RestMesh) -> dict[str, NDArray[np.int64]]:
    """Name in CONTACT_SETS -> vertex ids, ascending, cavities left out."""
    part = label_parts(mesh.weights)
    x, y = mesh.vertices[:, 0], mesh.vertices[:, 1]
    down, back = -mesh.normals[:, 1], -mesh.normals[:, 2]

    def within(*names: str) -> NDArray[np.bool_]:
        return mesh.outer & np.isin(part, [PART_NAMES.index(name) for name in names])

    def height(name: str) -> float:
        return float(mesh.joints[JOINT_INDEX[name], 1])

    chosen: dict[str, NDArray[np.bool_]] = {}
    for side in SIDES:
        foot = within(f"{side}_foot")
        low = y - (y[foot].min() if foot.any() else 0.0)
        chosen[f"{side}_sole"] = foot & (low < _SOLE_DEPTH) & (down > 0.5)
        chosen[f"{side}_foot"] = foot & (low < _FOOT_DEPTH) & (down > -0.3)
        chosen[f"{side}_hand"] = within(f"{side}_hand") & (down > 0.2)
    hips = (height("left_hip") + height("right_hip")) / 2
    knees = (height("left_knee") + height("right_knee")) / 2
    thigh = hips - knees
    seat_low, seat_high = hips - 0.25 * thigh, hips + 0.25 * thigh
    behind = back > 0.3
    legs = within("left_upper_leg", "right_upper_leg")
    torso = within("torso")
    chosen["thighs"] = legs & behind & (y < seat_low)
    chosen["gluteus"] = (legs | torso) & behind & (y >= seat_low) & (y < seat_high)
    chosen["back"] = (
        torso & behind & (y >= seat_high) & (np.abs(x) < np.abs(mesh.joints[JOINT_INDEX["left_shoulder"], 0]))
    )
    return {name: np.flatnonzero(chosen[name]) for name in CONTACT_SETS}
