"""Arrays of a body model in NumPy, for what shows or writes posed bodies without posing them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import JOINT_NAMES, PART_NAMES

if TYPE_CHECKING:
    from physic_core.types import AnyArray, Float64Array, Int64Array


@dataclass(frozen=True)
class VertexSets:
    """Named vertex sets of one mesh topology; all ids int64, ascending.

    Attributes:
        part_of_vertex: (V,) index into PART_NAMES.
        contact_sets: name in CONTACT_SETS -> ids.
        surface_points: name in SURFACE_POINTS -> ids.
        extremes: ids that can be the highest or the lowest point in the T-pose.
    """

    part_of_vertex: AnyArray
    contact_sets: Mapping[str, AnyArray]
    surface_points: Mapping[str, AnyArray]
    extremes: AnyArray


@dataclass(frozen=True, eq=False)
class BodyArrays:
    """Arrays of a body model asset, in metres, float32; named as in BodyModel, Kinematics and Skin.

    Attributes:
        template: (V, 3).
        directions: (D, V, 3): K shape rows, E expression rows, then 486 pose rows or none.
        joint_template: (55, 3).
        joint_directions: (K + E, 55, 3).
        bind_rot: (55, 3, 3), or None.
        weights: (V, 55).
        faces: (F, 3).
        outer: (V,) bool.
        picks: None to derive them from the geometry.
    """

    name: str
    topology: str
    template: AnyArray
    directions: AnyArray
    joint_template: AnyArray
    joint_directions: AnyArray
    bind_rot: AnyArray | None
    weights: AnyArray
    faces: AnyArray
    num_betas: int
    num_expression: int
    outer: AnyArray
    picks: VertexSets | None = None
    info: str = ""

    @cached_property
    def part_of_vertex(self) -> Int64Array:
        """Body part (V,) of each vertex, an index into PART_NAMES."""
        if self.picks is None:
            return label_parts(self.weights.astype(np.float64))
        return self.picks.part_of_vertex.astype(np.int64)

    def rest_joints(self, shape: Float64Array) -> Float64Array:
        """Return the joints (55, 3) of a shape (K + E,) in the bind pose, metres."""
        return np.asarray(
            self.joint_template + np.tensordot(shape, self.joint_directions, 1), np.float64
        )


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


def label_parts(weights: Float64Array) -> Int64Array:
    """Return the body part (V,) with the largest sum of skinning weights (V, 55), as an index into
    PART_NAMES.
    """
    member = np.zeros((len(JOINT_NAMES), len(PART_NAMES)))
    for joint, name in enumerate(JOINT_NAMES):
        member[joint, PART_NAMES.index(_part_of_joint(name))] = 1.0
    # Vertices on the middle plane belong to left and right alike but for rounding: ties go to the
    # first part.
    labels: Int64Array = np.argmax((weights @ member).round(6), axis=1)
    return labels
