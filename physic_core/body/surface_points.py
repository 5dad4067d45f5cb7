"""Find landmark vertices (nose, ears, fingertips, toes) on a T-posed mesh, from its geometry."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physic_core.body.joints import JOINT_INDEX, PART_NAMES
from physic_core.body.landmarks import SURFACE_POINTS
from physic_core.body.parts import TPoseMesh, label_parts
from physic_core.types.skeletons import SIDES

_EYE_HALF_WIDTH = 0.015
"""Distance from the centre of an eye to its corners, metres."""
_MOUTH_HALF_WIDTH = 0.024
"""Distance from the centre of the mouth to its corners, metres."""
_MOUTH_DROP = 0.85
"""Height of the mouth below the tip of the nose, relative to the height of the eyes above it."""
_EAR_DEPTH, _EAR_FORWARD = 0.012, 0.012
"""Distance from the centre of the ear's rim inwards and forwards to the ear canal, metres."""


def pick_surface_points(mesh: TPoseMesh) -> dict[str, NDArray[np.int64]]:
    """Return landmark name -> vertex ids, for each name in SURFACE_POINTS. A landmark is the mean of its vertices."""
    part = label_parts(mesh.weights)
    joint = {name: mesh.joints[i] for name, i in JOINT_INDEX.items()}
    whole_head = part == PART_NAMES.index("head")  # with the lids or eyeballs, which are not part of the outer surface
    head = mesh.outer & whole_head
    picks: dict[str, NDArray[np.int64]] = {}
    middle = head & (np.abs(mesh.vertices[:, 0]) < 0.015)
    picks["nose"] = _furthest(mesh, middle if middle.any() else head, np.array([0.0, 0.0, 1.0]), 2)
    nose = mesh.vertices[picks["nose"]].mean(0)
    eye_height = (joint["left_eye"][1] + joint["right_eye"][1]) / 2
    mouth_height = nose[1] - _MOUTH_DROP * (eye_height - nose[1])
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        eye = joint[f"{side}_eye"]
        out = np.array([sign * _EYE_HALF_WIDTH, 0.0, 0.0])
        picks[f"{side}_eye_surface"] = _in_front(mesh, whole_head, eye, 4)
        picks[f"{side}_eye_inner_surface"] = _in_front(mesh, whole_head, eye - out, 3)
        picks[f"{side}_eye_outer_surface"] = _in_front(mesh, whole_head, eye + out, 3)
        corner = np.array([sign * _MOUTH_HALF_WIDTH, mouth_height, eye[2]])
        picks[f"{side}_mouth_corner_surface"] = _in_front(mesh, head, corner, 3)
        rim = mesh.vertices[_furthest(mesh, head, np.array([sign, 0.0, 0.0]), 40)].mean(0)
        canal = rim + np.array([-sign * _EAR_DEPTH, 0.0, _EAR_FORWARD])
        picks[f"{side}_ear_surface"] = _nearest(mesh, head, canal, 8)
        for finger in ("thumb", "index", "middle", "ring", "pinky"):
            last = JOINT_INDEX[f"{side}_{finger}3"]
            tip = mesh.outer & (mesh.weights.argmax(1) == last)
            along = mesh.joints[last] - mesh.joints[last - 1]
            picks[f"{side}_{finger}_tip"] = _furthest(mesh, tip, along, 4)
        picks.update(_pick_foot(mesh, mesh.outer & (part == PART_NAMES.index(f"{side}_foot")), side, sign))
    return {name: picks[name] for name in SURFACE_POINTS}


def _pick_foot(mesh: TPoseMesh, foot: NDArray[np.bool_], side: str, sign: float) -> dict[str, NDArray[np.int64]]:
    """Return the vertex ids of toes, heel and foot tip of one foot."""
    x, _, z = mesh.vertices.T
    forward = np.array([0.0, 0.0, 1.0])
    toes = foot & (z > mesh.joints[JOINT_INDEX[f"{side}_foot"], 2])
    if not toes.any():
        toes = foot
    lateral = sign * x
    low, high = lateral[toes].min(), lateral[toes].max()
    medial_half = toes & (lateral <= low + 0.35 * (high - low))
    lateral_rim = toes & (lateral >= low + 0.85 * (high - low))
    return {
        f"{side}_big_toe": _furthest(mesh, medial_half, forward, 4),
        f"{side}_small_toe": _furthest(mesh, lateral_rim, forward, 4),
        f"{side}_foot_tip": _furthest(mesh, toes, forward, 6),
        f"{side}_heel": _furthest(mesh, foot, np.array([0.0, -0.5, -1.0]), 6),
    }


def _furthest(
    mesh: TPoseMesh, mask: NDArray[np.bool_], direction: NDArray[np.float64], count: int
) -> NDArray[np.int64]:
    """Return the ids of the ``count`` vertices of the mask that are furthest along a direction."""
    return _first(mask, -(mesh.vertices @ direction), count)


def _nearest(mesh: TPoseMesh, mask: NDArray[np.bool_], point: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Return the ids of the ``count`` vertices of the mask nearest to a point."""
    return _first(mask, np.linalg.norm(mesh.vertices - point, axis=1), count)


def _in_front(mesh: TPoseMesh, mask: NDArray[np.bool_], point: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Return the ids of the ``count`` forward-facing vertices of the mask nearest to the +z ray from ``point``."""
    facing = mask & (mesh.vertices[:, 2] > point[2]) & (mesh.normals[:, 2] > 0)
    off_axis = np.linalg.norm(mesh.vertices[:, :2] - point[:2], axis=1)
    return _first(facing if facing.any() else mask, off_axis, count)


def _first(mask: NDArray[np.bool_], cost: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Return the ids of the ``count`` vertices of the mask with the least cost, ascending; of all if it is empty."""
    ids = np.flatnonzero(mask if mask.any() else np.ones_like(mask))
    # Mirrored vertices have the same cost but for rounding: ties go to the first vertex.
    return np.sort(ids[np.argsort(cost[ids].round(6), kind="stable")[:count]])
