"""Skin patches for contact targets, and a thinned set of skin vertices for penetration tests.

Works for any body in SMPL-X layout; picked on its mean shape in the T-pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import JOINT_INDEX
from physic_core.types.skeletons import SIDES
from physic_testing.worlds.reproducible_math import norm
from physic_testing.worlds.skinning import Skinner

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray

    Ids = NDArray[np.int64]

__all__ = ["ContactSkin", "contact_skin", "crossing_allowed", "folding_parts", "vertex_normals"]

_COARSE, _FINE = 0.03, 0.014  # metres between kept vertices: of the body, of hands, feet and patches
_NEIGHBOURS = 0.12  # metres in the T-pose: nearer patches of skin may fold onto each other


@dataclass(frozen=True, eq=False)
class ContactSkin:
    """Faces, vertex sets and body parts of a body surface.

    Attributes:
        faces: (F, 3) int64.
        outer: (n,) ids of the outer vertices.
        thinned: (m,) ids of a subset of the outer vertices, a few centimetres apart.
        rest: (V, 3) vertices of the mean body in T-pose, m.
        part: (V,) index into ``part_names``.
        part_names: names of the body parts.
        patches: name -> ids: "left_sole", "left_ball", "left_heel", "left_instep", "left_knee", "left_lap",
            "left_shin", "left_calf", "left_thigh", "left_hip", "left_leg_side", "left_foot_side", "left_palm",
            "left_forearm", "left_lower_arm", "left_elbow", "left_waist", "left_shoulder", "left_temple", the same of
            the right, and "gluteus", "back", "upper_back", "head_back", "chest", "lap", "chin".
    """

    faces: NDArray[np.int64]
    outer: Ids
    thinned: Ids
    rest: FloatArray
    part: Ids
    part_names: tuple[str, ...]
    patches: dict[str, Ids]


@lru_cache(maxsize=4)
def contact_skin(model: BodyModel) -> ContactSkin:
    """Return the skin patches and vertex sets of a body model; recent results are cached."""
    rest, joints = Skinner(model, np.zeros(model.num_betas))(np.tile(np.eye(3), (55, 1, 1)), np.zeros(3))
    faces, outer = model.faces.numpy(), model.outer.numpy()
    part = model.part_of_vertex.numpy()
    patches = _patches(model, rest, joints, vertex_normals(rest, faces), part)
    fine = np.isin(part, [model.part_names.index(f"{side}_{limb}") for side in SIDES for limb in ("hand", "foot")])
    kept = [_thin(rest, np.flatnonzero(outer & ~fine), _COARSE), _thin(rest, np.flatnonzero(outer & fine), _FINE)]
    thinned = np.unique(np.concatenate(kept))
    return ContactSkin(faces, np.flatnonzero(outer), thinned, rest, part, model.part_names, patches)


def vertex_normals(vertices: FloatArray, faces: NDArray[np.int64]) -> FloatArray:
    """Return area-weighted unit vertex normals (V, 3), outwards."""
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = faces.reshape(-1)
    total = np.stack([np.bincount(flat, np.repeat(across[:, k], 3), len(vertices)) for k in range(3)], axis=1)
    unit: FloatArray = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)
    return unit


def crossing_allowed(skin: ContactSkin, first: Ids, second: Ids) -> NDArray[np.bool_]:
    """Return whether vertices ``first`` (n,) may penetrate the skin at vertices ``second`` (n,), as (n,) bool.

    They may where flesh folds: within one part, at neighbouring spots, and between trunk, thighs and shanks of one
    side, which press into each other in a deep bend.
    """
    near = norm(skin.rest[first] - skin.rest[second]) < _NEIGHBOURS
    allowed: NDArray[np.bool_] = folding_parts(skin.part_names)[skin.part[first], skin.part[second]] | near
    return allowed


@lru_cache(maxsize=4)
def folding_parts(names: tuple[str, ...]) -> NDArray[np.bool_]:
    """Return a table (P, P) bool of body parts whose vertices may penetrate another part, such as neighbours."""
    fold = np.eye(len(names), dtype=bool)
    for side in SIDES:
        for one, other in (
            ("torso", f"{side}_upper_leg"),
            (f"{side}_upper_leg", f"{side}_lower_leg"),
            (f"{side}_lower_leg", f"{side}_foot"),
            (f"{side}_upper_arm", f"{side}_lower_arm"),
            (f"{side}_lower_arm", f"{side}_hand"),
            ("head", "torso"),
        ):
            a, b = names.index(one), names.index(other)
            fold[a, b] = fold[b, a] = True
        # Planes through vertices of fingers tell little of what is inside a hand.
        fold[:, names.index(f"{side}_hand")] = True
    return fold


def _thin(points: FloatArray, ids: Ids, spacing: float) -> Ids:
    """Keep the first vertex of each cube of a grid."""
    cells = np.floor(points[ids] / spacing).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    chosen: Ids = ids[np.sort(first)]
    return chosen


def _patches(model: BodyModel, rest: FloatArray, joints: FloatArray, normals: FloatArray, part: Ids) -> dict[str, Ids]:
    """Select the vertices of each skin patch."""
    outer = model.outer.numpy()
    x, y, z = rest.T

    def of(*names: str) -> NDArray[np.bool_]:
        chosen: NDArray[np.bool_] = outer & np.isin(part, [model.part_names.index(name) for name in names])
        return chosen

    def at(name: str) -> FloatArray:
        place: FloatArray = joints[JOINT_INDEX[name]]
        return place

    given = {name: ids.numpy() for name, ids in model.contact_sets.items()}
    found: dict[str, Ids] = {"gluteus": given["gluteus"], "back": given["back"]}
    found["upper_back"] = given["back"][rest[given["back"], 1] > at("spine3")[1]]
    found["head_back"] = np.flatnonzero(of("head") & (normals[:, 2] < -0.5) & (y > at("head")[1]))
    found["chest"] = np.flatnonzero(
        of("torso") & (normals[:, 2] > 0.4) & (y > at("spine2")[1]) & (y < at("neck")[1] - 0.06)
    )
    mouth = rest[model.surface_points["left_mouth_corner_surface"].numpy(), 1].mean()
    found["chin"] = np.flatnonzero(of("head") & (z > at("head")[2] + 0.04) & (y < mouth - 0.01) & (normals[:, 1] < 0.2))
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        sideways = sign * normals[:, 0]
        hip, knee, ankle = (at(f"{side}_{name}") for name in ("hip", "knee", "ankle"))
        foot, shoulder = at(f"{side}_foot"), at(f"{side}_shoulder")
        upper, lower = of(f"{side}_upper_leg"), of(f"{side}_lower_leg")
        lower_arm, sole = of(f"{side}_lower_arm"), given[f"{side}_sole"]
        masks = {
            "instep": of(f"{side}_foot") & (normals[:, 1] > 0.5) & (z > ankle[2] + 0.03),
            "knee": (upper | lower) & (normals[:, 2] > 0.5) & (y < knee[1] + 0.02) & (y > knee[1] - 0.12),
            "lap": upper & (normals[:, 2] > 0.4) & (y < hip[1] - 0.14) & (y > knee[1] + 0.02),
            "shin": lower & (normals[:, 2] > 0.5) & (y < knee[1] - 0.06),
            "calf": lower & (normals[:, 2] < -0.5),
            "hip": (upper | of("torso")) & (sideways > 0.6) & (np.abs(y - hip[1]) < 0.14) & (sign * x > 0),
            "leg_side": (upper | lower) & (sideways > 0.6) & (y < hip[1] - 0.1),
            "foot_side": of(f"{side}_foot") & (sideways > 0.5),
            "elbow": of(f"{side}_upper_arm", f"{side}_lower_arm") & (norm(rest - at(f"{side}_elbow")) < 0.09),
            "waist": of("torso") & (sideways > 0.5) & (y > hip[1] + 0.04) & (y < at("spine2")[1]),
            "lower_arm": lower_arm,
            "forearm": lower_arm & (normals[:, 1] < -0.3),
            "shoulder": of("torso", f"{side}_upper_arm")
            & (normals[:, 1] > 0.0)
            & (np.linalg.norm(rest - shoulder - [sign * 0.03, 0.03, 0], axis=1) < 0.09),
            "temple": of("head") & (sideways > 0.6) & (y > at("head")[1] + 0.02),
        }
        found.update({f"{side}_{name}": np.flatnonzero(mask) for name, mask in masks.items()})
        found[f"{side}_sole"] = sole
        found[f"{side}_ball"] = sole[rest[sole, 2] > foot[2] - 0.03]
        found[f"{side}_heel"] = sole[rest[sole, 2] < ankle[2] + 0.02]
        found[f"{side}_palm"] = given[f"{side}_hand"]
        thighs = given["thighs"]
        found[f"{side}_thigh"] = thighs[sign * rest[thighs, 0] > 0]
    found["lap"] = np.union1d(found["left_lap"], found["right_lap"])
    return found
