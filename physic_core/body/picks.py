"""Geometric picks of surface landmarks on a T-posed mesh in SMPL-X layout: no vertex id comes from anybody's list."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physic_core.body.joints import JOINT_INDEX, SIDES
from physic_core.body.landmarks import SURFACE_POINTS
from physic_core.body.parts import PART_NAMES, label_parts
from physic_core.body.rest_mesh import RestMesh

__all__ = ["pick_surface_points"]

_EYE_HALF_WIDTH = 0.015
"""Metres from the middle of an eye to its corners."""
_MOUTH_HALF_WIDTH = 0.024
"""Metres from the middle of the mouth to its corners."""
_MOUTH_DROP = 0.75
"""Height of the mouth under the nose's tip, as a share of the height of the eyes over it."""


def pick_surface_points(mesh: RestMesh) -> dict[str, NDArray[np.int64]]:
    """Name in SURFACE_POINTS -> ids of the vertices whose mean is that point."""
    part = label_parts(mesh.weights)
    joint = {name: mesh.joints[i] for name, i in JOINT_INDEX.items()}
    head = mesh.outer & (part == PART_NAMES.index("head"))
    picks: dict[str, NDArray[np.int64]] = {}
    middle = head & (np.abs(mesh.vertices[:, 0]) < 0.015)
    picks["nose"] = _furthest(mesh, middle if middle.any() else head, np.array([0.0, 0.0, 1.0]), 2)
    nose = mesh.vertices[picks["nose"]].mean(0)
    eye_height = (joint["left_eye"][1] + joint["right_eye"][1]) / 2
    mouth_height = nose[1] - _MOUTH_DROP * (eye_height - nose[1])
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        eye = joint[f"{side}_eye"]
        out = np.array([sign * _EYE_HALF_WIDTH, 0.0, 0.0])
        picks[f"{side}_eye_surface"] = _in_front(mesh, head, eye, 4)
        picks[f"{side}_eye_inner_surface"] = _in_front(mesh, head, eye - out, 3)
        picks[f"{side}_eye_outer_surface"] = _in_front(mesh, head, eye + out, 3)
        corner = np.array([sign * _MOUTH_HALF_WIDTH, mouth_height, eye[2]])
        picks[f"{side}_mouth_corner_surface"] = _in_front(mesh, head, corner, 3)
        picks[f"{side}_ear_surface"] = _furthest(mesh, head, np.array([sign, 0.0, 0.0]), 12)
        for finger in ("thumb", "index", "middle", "ring", "pinky"):
            last = JOINT_INDEX[f"{side}_{finger}3"]
            tip = mesh.outer & (mesh.weights.argmax(1) == last)
            along = mesh.joints[last] - mesh.joints[last - 1]
            picks[f"{side}_{finger}_tip"] = _furthest(mesh, tip, along, 4)
        picks.update(_pick_foot(mesh, mesh.outer & (part == PART_NAMES.index(f"{side}_foot")), side, sign))
    return {name: picks[name] for name in SURFACE_POINTS}


def _pick_foot(mesh: RestMesh, foot: NDArray[np.bool_], side: str, sign: float) -> dict[str, NDArray[np.int64]]:
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
        f"{side}_heel": _furthest(mesh, foot, -forward, 6),
    }


def _furthest(mesh: RestMesh, mask: NDArray[np.bool_], direction: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Ids of the ``count`` vertices of the mask that lie furthest along a direction."""
    ids = np.flatnonzero(mask)
    order = np.argsort(-(mesh.vertices[ids] @ direction), kind="stable")
    return np.sort(ids[order[:count]])


def _in_front(mesh: RestMesh, mask: NDArray[np.bool_], point: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Ids of the ``count`` forward-facing vertices of the mask nearest to the line that leaves ``point`` along +z."""
    facing = mask & (mesh.vertices[:, 2] > point[2]) & (mesh.normals[:, 2] > 0)
    ids = np.flatnonzero(facing if facing.any() else mask)
    off_axis = np.linalg.norm(mesh.vertices[ids, :2] - point[:2], axis=1)
    return np.sort(ids[np.argsort(off_axis, kind="stable")[:count]])
