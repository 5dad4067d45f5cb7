"""Points, parts and vertex sets of a body: keypoints of skeletons, body parts, and what often
touches the scene.

Each keypoint is a joint of the model, or the mean of a few surface vertices. Left is always the
body's own left.

Parts follow from skinning weights. Contact sets (as in PROX: feet, thighs, gluteus, back, hands)
and landmarks (nose, ears, fingertips, toes) follow from the geometry of the T-pose. All work for
any mesh with SMPL-X joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from physic_core.body.arrays import label_parts
from physic_core.body.joints import JOINT_INDEX, JOINT_NAMES, NUM_JOINTS, PART_NAMES, joint_pair
from physic_core.errors import BodyModelError
from physic_core.geometry.mesh import vertex_normals
from physic_core.types import Keypoints
from physic_core.types.skeletons import SIDES, Skeleton

if TYPE_CHECKING:
    from physic_core.types import BoolArray, Float64Array, Int64Array


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

CONTACT_SETS: tuple[str, ...] = (
    *(f"{side}_{name}" for name in ("sole", "foot", "hand") for side in SIDES),
    "thighs",
    "gluteus",
    "back",
)
"""Names of the sets: soles, soles with lower half of the feet, palms and fingers, underside of
thighs, seat, back.
"""


def keypoints_on_body(keypoints: Keypoints) -> Keypoints:
    """Remove the keypoints whose position on a body model is not defined by the skeleton."""
    skeleton = keypoints.joint_set
    if len(skeleton.fitted) == len(skeleton):
        return keypoints
    return keypoints.take(skeleton.fitted)


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
        """Map joints (..., 55, 3) and the n vertices (..., n, 3) to points (..., J, 3)."""
        return self.matrix @ torch.cat([joints, vertices], -2)


def skeleton_regressor(skeleton: Skeleton, picks: Mapping[str, Tensor]) -> LandmarkRegressor:
    """Build the linear map from a body to the keypoints of a skeleton, float32 on the CPU.

    Args:
        skeleton: all of its points must be defined on a body, see ``Skeleton.fitted``.
        picks: name in SURFACE_POINTS -> vertex ids.

    Raises:
        BodyModelError: a point is not defined on a body, or refers to an unknown point.
    """
    blend, names = _landmark_weights(skeleton)
    groups = [picks[name] for name in names if name not in JOINT_INDEX]
    ids = torch.cat([torch.zeros(0, dtype=torch.int64), *groups])
    points = torch.zeros(len(names), NUM_JOINTS + len(ids))
    start = NUM_JOINTS
    for row, name in enumerate(names):
        if name in JOINT_INDEX:
            points[row, JOINT_INDEX[name]] = 1.0
        else:
            count = len(picks[name])
            points[row, start : start + count] = 1.0 / count
            start += count
    return LandmarkRegressor(ids, blend @ points)


def _landmark_weights(skeleton: Skeleton) -> tuple[Tensor, list[str]]:
    """Return the (J, P) weights of P body points for each keypoint, with rows that sum to 1, and
    the P names.
    """
    used = [other for blend in skeleton.on_body.values() for other in blend]
    names = list(dict.fromkeys(name for name in (*skeleton.names, *used) if name in BODY_POINTS))
    column = {name: i for i, name in enumerate(names)}
    blend = torch.zeros(len(skeleton), len(names))
    for row, name in enumerate(skeleton.names):
        shares = skeleton.on_body.get(name, {})
        _check_definition(skeleton.name, name, shares)
        if name in column:
            blend[row, column[name]] = 1
        for other, share in shares.items():
            blend[row, column[other]] += share
            if name in column:
                blend[row, column[name]] -= share
    return blend, names


_SHARES_OFF = 1e-6


def _check_definition(skeleton: str, name: str, shares: Mapping[str, float]) -> None:
    """Raise BodyModelError if a keypoint has no valid definition on the body."""
    if strange := [other for other in shares if other not in BODY_POINTS]:
        raise BodyModelError(
            f"the point {name!r} of the skeleton {skeleton!r} refers to {', '.join(strange)}, "
            f"which no body has: choose among {', '.join(BODY_POINTS)}"
        )
    if name not in BODY_POINTS and abs(sum(shares.values()) - 1) > _SHARES_OFF:
        raise BodyModelError(
            f"the point {name!r} of the skeleton {skeleton!r} is not a point of a body, and its "
            f"weights sum to {sum(shares.values()):g}, not 1: correct them in "
            f"Skeleton.on_body, or give {{}} to leave the point out of fits"
        )


@dataclass(frozen=True)
class TPoseMesh:
    """Mesh, joints and skinning weights of a body in the T-pose: y up, +z forward, left on +x,
    metres.

    Attributes:
        vertices: (V, 3).
        faces: (F, 3) int.
        joints: (55, 3) in SMPL-X order.
        weights: (V, 55) skinning weights.
        outer: (V,) bool, False for cavities.
    """

    vertices: Float64Array
    faces: Int64Array
    joints: Float64Array
    weights: Float64Array
    outer: BoolArray

    @cached_property
    def normals(self) -> Float64Array:
        """(V, 3) unit outward normals."""
        return vertex_normals(self.vertices, self.faces)

    @cached_property
    def part_of_vertex(self) -> Int64Array:
        """(V,) index into PART_NAMES."""
        return label_parts(self.weights)

    def outer_vertices(self, *parts: str) -> BoolArray:
        """Return the outer vertices (V,) bool of some parts."""
        return self.outer & np.isin(self.part_of_vertex, [PART_NAMES.index(name) for name in parts])


_SOLE_DEPTH = 0.02
"""Maximum height of a downward-facing sole vertex over the lowest point of the foot, metres."""
_FOOT_DEPTH = 0.045
"""Maximum height of the lower half of a foot over its lowest point, metres."""


def contact_set_vertices(mesh: TPoseMesh) -> dict[str, Int64Array]:
    """Return the vertex ids of each set in CONTACT_SETS, ascending, without cavities."""
    x, y, _ = mesh.vertices.T
    down = -mesh.normals[:, 1]
    behind = -mesh.normals[:, 2] > 0.3
    chosen: dict[str, BoolArray] = {}
    for side in SIDES:
        foot = mesh.outer_vertices(f"{side}_foot")
        low = y - (y[foot].min() if foot.any() else 0.0)
        chosen[f"{side}_sole"] = foot & (low < _SOLE_DEPTH) & (down > 0.5)
        chosen[f"{side}_foot"] = foot & (low < _FOOT_DEPTH) & (down > -0.3)
        chosen[f"{side}_hand"] = mesh.outer_vertices(f"{side}_hand") & (down > 0.2)
    hips, knees = (float(mesh.joints[joint_pair(name), 1].mean()) for name in ("hip", "knee"))
    thigh = hips - knees
    seat_low = hips - 0.25 * thigh
    seat_high = hips + 0.25 * thigh
    legs = mesh.outer_vertices("left_upper_leg", "right_upper_leg")
    torso = mesh.outer_vertices("torso")
    chosen["thighs"] = legs & behind & (y < seat_low)
    chosen["gluteus"] = (legs | torso) & behind & (y >= seat_low) & (y < seat_high)
    chosen["back"] = (
        torso
        & behind
        & (y >= seat_high)
        & (np.abs(x) < np.abs(mesh.joints[JOINT_INDEX["left_shoulder"], 0]))
    )
    return {name: np.flatnonzero(chosen[name]) for name in CONTACT_SETS}


def pick_surface_points(mesh: TPoseMesh) -> dict[str, Int64Array]:
    """Return landmark name -> vertex ids, for each name in SURFACE_POINTS.

    A landmark is the mean of its vertices.
    """
    picks = _pick_face(mesh)
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        for finger in ("thumb", "index", "middle", "ring", "pinky"):
            last = JOINT_INDEX[f"{side}_{finger}3"]
            tip = mesh.outer & (mesh.weights.argmax(1) == last)
            along = mesh.joints[last] - mesh.joints[last - 1]
            picks[f"{side}_{finger}_tip"] = _furthest(mesh, tip, along, 4)
        picks |= _pick_foot(mesh, side, sign)
    return {name: picks[name] for name in SURFACE_POINTS}


_EYE_HALF_WIDTH = 0.015
"""Distance from the centre of an eye to its corners, metres."""

_MOUTH_HALF_WIDTH = 0.024
"""Distance from the centre of the mouth to its corners, metres."""

_MOUTH_DROP = 0.85
"""Height of the mouth below the tip of the nose, relative to the height of the eyes above it."""

_EAR_DEPTH = 0.012

_EAR_FORWARD = 0.012
"""Distance from the centre of the ear's rim inwards and forwards to the ear canal, metres."""


def _pick_face(mesh: TPoseMesh) -> dict[str, Int64Array]:
    """Return the vertex ids of nose, eyes, mouth and ears."""
    head = mesh.outer_vertices("head")
    # With lids or eyeballs, which are not part of the outer surface.
    whole_head = mesh.part_of_vertex == PART_NAMES.index("head")
    eyes = mesh.joints[joint_pair("eye")]
    picks: dict[str, Int64Array] = {}
    midline = head & (np.abs(mesh.vertices[:, 0]) < 0.015)
    picks["nose"] = _furthest(
        mesh, midline if midline.any() else head, np.array([0.0, 0.0, 1.0]), 2
    )
    nose = mesh.vertices[picks["nose"]].mean(0)
    mouth_height = nose[1] - _MOUTH_DROP * (eyes[:, 1].mean() - nose[1])
    for side, sign, eye in zip(SIDES, (1.0, -1.0), eyes, strict=True):
        out = np.array([sign * _EYE_HALF_WIDTH, 0.0, 0.0])
        picks[f"{side}_eye_surface"] = _nearest_to_forward_ray(mesh, whole_head, eye, 4)
        picks[f"{side}_eye_inner_surface"] = _nearest_to_forward_ray(mesh, whole_head, eye - out, 3)
        picks[f"{side}_eye_outer_surface"] = _nearest_to_forward_ray(mesh, whole_head, eye + out, 3)
        corner = np.array([sign * _MOUTH_HALF_WIDTH, mouth_height, eye[2]])
        picks[f"{side}_mouth_corner_surface"] = _nearest_to_forward_ray(mesh, head, corner, 3)
        rim = mesh.vertices[_furthest(mesh, head, np.array([sign, 0.0, 0.0]), 40)].mean(0)
        canal = rim + np.array([-sign * _EAR_DEPTH, 0.0, _EAR_FORWARD])
        apart = np.linalg.norm(mesh.vertices - canal, axis=1)
        picks[f"{side}_ear_surface"] = _lowest_cost(head, apart, 8)
    return picks


def _pick_foot(mesh: TPoseMesh, side: str, sign: float) -> dict[str, Int64Array]:
    """Return the vertex ids of toes, heel and foot tip of one foot."""
    foot = mesh.outer_vertices(f"{side}_foot")
    x, _, z = mesh.vertices.T
    forward = np.array([0.0, 0.0, 1.0])
    toes = foot & (z > mesh.joints[JOINT_INDEX[f"{side}_foot"], 2])
    if not toes.any():
        toes = foot
    lateral = sign * x
    low = lateral[toes].min()
    high = lateral[toes].max()
    medial_half = toes & (lateral <= low + 0.35 * (high - low))
    lateral_rim = toes & (lateral >= low + 0.85 * (high - low))
    return {
        f"{side}_big_toe": _furthest(mesh, medial_half, forward, 4),
        f"{side}_small_toe": _furthest(mesh, lateral_rim, forward, 4),
        f"{side}_foot_tip": _furthest(mesh, toes, forward, 6),
        f"{side}_heel": _furthest(mesh, foot, np.array([0.0, -0.5, -1.0]), 6),
    }


def _furthest(mesh: TPoseMesh, mask: BoolArray, direction: Float64Array, count: int) -> Int64Array:
    """Return the ids of the ``count`` vertices of the mask that are furthest along a direction."""
    return _lowest_cost(mask, -(mesh.vertices @ direction), count)


def _nearest_to_forward_ray(
    mesh: TPoseMesh, mask: BoolArray, point: Float64Array, count: int
) -> Int64Array:
    """Return the ids of the ``count`` forward-facing vertices of the mask nearest to the +z ray
    from ``point``.
    """
    facing = mask & (mesh.vertices[:, 2] > point[2]) & (mesh.normals[:, 2] > 0)
    off_axis = np.linalg.norm(mesh.vertices[:, :2] - point[:2], axis=1)
    return _lowest_cost(facing if facing.any() else mask, off_axis, count)


def _lowest_cost(mask: BoolArray, cost: Float64Array, count: int) -> Int64Array:
    """Return the ids of the ``count`` vertices of the mask with the least cost, ascending; of all
    if it is empty.
    """
    ids = np.flatnonzero(mask if mask.any() else np.ones_like(mask))
    # Mirrored vertices have the same cost but for rounding: ties go to the first vertex.
    return np.sort(ids[np.argsort(cost[ids].round(6), kind="stable")[:count]])
