"""A body of other proportions and skin than any shape of the body model that is fitted, on the same
mesh.

Vertices and joints keep their indices, so that joints, contacts and landmarks of the truth have an
exact counterpart.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import JOINT_NAMES, PARENTS
from physic_testing.worlds.reproducible_math import apply, norm, round_to_grid, sin_cos

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray

__all__ = ["other_body"]

_LENGTH_SIGMA = {
    # of thigh, shank, upper arm and forearm
    **dict.fromkeys(("knee", "ankle", "elbow", "wrist"), 0.07),
    **dict.fromkeys(("hip", "shoulder", "collar"), 0.10),  # widths of pelvis and shoulders
    **dict.fromkeys(("spine1", "spine2", "spine3", "neck", "head"), 0.04),
    "foot": 0.05,
}
"""Joint at the end of a bone -> standard deviation of the logarithm of the bone's length; both
sides are alike.
"""

_GIRTH_SIGMA = 0.06  # of the logarithm of a limb's thickness
_SKIN_M = 0.006  # standard deviation of the skin's own displacement
_WAVELENGTH_M = 0.25
_WAVES = 10


def other_body(model: BodyModel, rng: np.random.Generator) -> BodyModel:
    """Return a body whose bones have other lengths and whose skin lies elsewhere, for all shapes of
    the model.

    Each bone is stretched along its axis and across it, about the joints of the mean shape; the
    skin follows by the skinning weights. A smooth random displacement of the skin is added. Names,
    faces, weights and contact sets stay.

    Args:
        model: body model in float64, without pose correctives.
        rng: draws the changes.
    """
    import torch

    skin = model.skin
    kinematics = model.kinematics
    shapes = model.num_betas + model.num_expression
    vertices = np.ascontiguousarray(skin.template.double().numpy().T)
    joints = kinematics.template.double().numpy()
    weights = skin.weights.double().numpy()
    lengths = _bone_factors(rng)
    stretches = _bone_stretches(joints, lengths, rng)

    def changed(points: FloatArray, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        return _stretched(points, places, weights, lengths, stretches)

    new_vertices, new_joints = changed(vertices, joints)
    directions = []
    joint_directions = []
    by_shape = kinematics.directions.double().numpy().reshape(-1, *joints.shape)
    for row in range(shapes):
        points, places = changed(
            np.ascontiguousarray(skin.directions[row].double().numpy().T), by_shape[row]
        )
        directions.append(points.T)
        joint_directions.append(places.reshape(-1))
    new_vertices = new_vertices + _displacement(vertices, rng)
    like = skin.template
    return replace(
        model,
        kinematics=replace(
            kinematics,
            template=torch.from_numpy(new_joints).to(like),
            directions=torch.from_numpy(np.stack(joint_directions)).to(like),
        ),
        skin=replace(
            skin,
            template=torch.from_numpy(np.ascontiguousarray(new_vertices.T)).to(like),
            directions=torch.from_numpy(np.stack(directions)).to(like),
        ),
    )


def _bone_factors(rng: np.random.Generator) -> FloatArray:
    """Return the factor (55,) on the length of the bone that ends at each joint; left and right are
    alike.
    """
    draws = {
        name: 1 + sigma * float(np.clip(rng.normal(), -2, 2))
        for name, sigma in _LENGTH_SIGMA.items()
    }
    names = [name.removeprefix("left_").removeprefix("right_") for name in JOINT_NAMES]
    return np.array([draws.get(name, 1.0) for name in names])


def _bone_stretches(
    joints: FloatArray, lengths: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Return the linear map (55, 3, 3) of the skin round each bone: along its axis, and across by
    its girth.
    """
    maps = np.tile(np.eye(3), (len(joints), 1, 1))
    girths = {
        kind: 1 + _GIRTH_SIGMA * float(np.clip(rng.normal(), -2, 2))
        for kind in ("hip", "knee", "shoulder", "elbow")
    }
    for joint, name in enumerate(JOINT_NAMES):
        kind = name.removeprefix("left_").removeprefix("right_")
        if kind not in girths:
            continue
        child = PARENTS.index(joint)
        axis = joints[child] - joints[joint]
        axis = axis / norm(axis)
        along = axis[:, None] * axis[None, :]
        maps[joint] = lengths[child] * along + girths[kind] * (np.eye(3) - along)
    return maps


def _stretched(
    points: FloatArray,
    joints: FloatArray,
    weights: FloatArray,
    lengths: FloatArray,
    maps: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return points (V, 3) and joints (55, 3) after the stretch, which is linear in both
    together.
    """
    moved = joints.copy()
    for joint in range(1, len(joints)):
        parent = PARENTS[joint]
        moved[joint] = moved[parent] + lengths[joint] * (joints[joint] - joints[parent])
    result = np.zeros_like(points)
    for bone in range(len(joints)):
        rows = np.flatnonzero(weights[bone])
        own = moved[bone] + apply(maps[bone], points[rows] - joints[bone])
        result[rows] += weights[bone, rows, None] * own
    return result, moved


def _displacement(vertices: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return a smooth random displacement (V, 3), m; both sides of the body are alike."""
    place = np.concatenate([np.abs(vertices[:, :1]), vertices[:, 1:]], axis=1)
    total = np.zeros_like(vertices)
    for _ in range(_WAVES):
        direction = rng.normal(size=3)
        amount = rng.normal(size=3)
        direction = direction / norm(direction) * (2 * np.pi / _WAVELENGTH_M)
        phase = rng.uniform(0, 2 * np.pi)
        angle = np.mod((place * direction).sum(-1) + phase, 2 * np.pi)
        total += sin_cos(angle)[0][:, None] * amount
    total *= _SKIN_M * np.sqrt(2 / _WAVES)
    total[:, 0] *= np.sign(vertices[:, 0])
    return round_to_grid(total)
