"""Body part of each vertex, and vertex sets that often are in contact with the scene.

Parts follow from skinning weights, contact sets from the geometry of the T-pose (as in PROX: feet, thighs, gluteus,
back, hands). Both work for any mesh with SMPL-X joints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physic_core.body.joints import JOINT_INDEX, JOINT_NAMES, PART_NAMES
from physic_core.geometry.mesh import vertex_normals
from physic_core.types.skeletons import SIDES


@dataclass(frozen=True)
class TPoseMesh:
    """Mesh, joints and skinning weights of a body in the T-pose: y up, +z forward, left on +x, metres.

    Attributes:
        vertices: (V, 3).
        faces: (F, 3) int.
        joints: (55, 3) in SMPL-X order.
        weights: (V, 55) skinning weights.
        outer: (V,) bool, False for cavities.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    joints: NDArray[np.float64]
    weights: NDArray[np.float64]
    outer: NDArray[np.bool_]

    @property
    def normals(self) -> NDArray[np.float64]:
        """(V, 3) unit outward normals."""
        return vertex_normals(self.vertices, self.faces)


CONTACT_SETS: tuple[str, ...] = (
    *(f"{side}_{name}" for name in ("sole", "foot", "hand") for side in SIDES),
    "thighs",
    "gluteus",
    "back",
)
"""Names of the sets: soles, soles with lower half of the feet, palms and fingers, underside of thighs, seat, back."""

_SOLE_DEPTH = 0.02
"""Maximum height of a downward-facing sole vertex over the lowest point of the foot, metres."""
_FOOT_DEPTH = 0.045
"""Maximum height of the lower half of a foot over its lowest point, metres."""


def _part_of_joint(name: str) -> str:
    """Return the name of the body part of a joint."""
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
    """Return the body part (V,) with the largest sum of skinning weights (V, 55), as an index into PART_NAMES."""
    member = np.zeros((len(JOINT_NAMES), len(PART_NAMES)))
    for joint, name in enumerate(JOINT_NAMES):
        member[joint, PART_NAMES.index(_part_of_joint(name))] = 1.0
    # Vertices on the middle plane belong to left and right alike but for rounding: ties go to the first part.
    labels: NDArray[np.int64] = np.argmax((weights @ member).round(6), axis=1)
    return labels


def contact_set_vertices(mesh: TPoseMesh) -> dict[str, NDArray[np.int64]]:
    """Return the vertex ids of each set in CONTACT_SETS, ascending, without cavities."""
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
