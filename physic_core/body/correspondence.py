"""Which point of another body's mesh each vertex of a model is: told on the user's machine, from two T-poses.

Nobody's published map is needed: the model is first laid onto the other mesh, part by part, by the same fit that
follows posed surfaces; then every vertex takes the nearest point that faces the same way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from physic_core.body.bones import FAMILY, fit_shape
from physic_core.body.joints import joint_pair
from physic_core.body.nearest_surface import Surface
from physic_core.body.part_fit import Fit
from physic_core.body.rest_mesh import vertex_normals
from physic_core.body.rotations import rotation_between
from physic_core.body.surface_fit import Patches, fit_surface, spread
from physic_core.errors import BodyModelError

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import RestMesh

__all__ = ["VERSION", "Correspondence", "correspondence", "register"]

Array = NDArray[np.float64]

VERSION = 1
"""To be raised when the same two meshes would give another map."""
_ROUNDS = 14
_REACH_M = (0.25, 0.02)
"""Farther points pull at nothing: at first, and in the end."""
_FACING = 0.4
"""Cosine between normals below which a point is none of the same surface."""
_NEAR_M = 0.03
"""A vertex farther from the other mesh has no counterpart there: it says nothing of where the body is."""
_TIP_M = 0.03
"""How well the tips of two bodies' limbs and crowns meet."""
_LIMBS = [*joint_pair("shoulder"), *joint_pair("hip")]
"""The joints where the limbs begin, in the order of their tips."""
_STATURE_M = (0.3, 3.0)


@dataclass(frozen=True)
class Correspondence:
    """For each vertex of a model its place on another mesh.

    Attributes:
        corners: (V, 3) int64 vertices of the other mesh.
        shares: (V, 3) of each in the place, not negative, with sum 1.
        sure: (V,) bool: it lies there, facing the same way; elsewhere it is only the nearest that there is.
    """

    corners: NDArray[np.int64]
    shares: Array
    sure: NDArray[np.bool_]

    def carry(self, values: NDArray[np.floating]) -> Array:
        """Values (..., V of the other mesh, C) at its vertices -> (..., V, C) at those of the model."""
        return sum(  # type: ignore[return-value]
            values[..., self.corners[:, k], :] * self.shares[:, k, None] for k in range(3)
        )

    def rows(self, ids: NDArray[np.int64]) -> Correspondence:
        """Of some vertices of the model."""
        return Correspondence(self.corners[ids], self.shares[ids], self.sure[ids])


def register(rest: RestMesh, model: BodyModel, patches: Patches, normals: Array) -> Fit:
    """The model laid onto a mesh in the T-pose.

    Args:
        rest: the mesh.
        model: the body model.
        patches: its vertices that are laid on it.
        normals: (n, 3) of these in the T-pose.
    """
    surface = Surface(rest.vertices.astype(np.float64), rest.faces.astype(np.int64))
    fit = _begin(rest, model)
    for step, reach in enumerate(np.geomspace(*_REACH_M, _ROUNDS)):
        start, slopes = patches.linear(fit.world)
        now = start + (slopes @ fit.betas[:, None, :, None])[..., 0] + fit.transl[:, None]
        turns = (patches.weights @ fit.world[0].reshape(-1, 9)).reshape(-1, 3, 3)
        facing = (turns @ normals[..., None])[..., 0]
        on = surface.nearest(now[0], facing)
        there = (on.shares[..., None] * rest.vertices[surface.faces[on.face]]).sum(1)
        weights = ((on.facing > _FACING) * np.exp(-0.5 * (on.distance / reach) ** 2))[None]
        # Far off, whole limbs move before single bones do.
        # Near by, the surfaces may glide along each other: where a vertex belongs, only the shape of the whole says.
        glide = surface.normals[on.face][None] if step >= _ROUNDS // 3 else None
        fit = fit_surface(patches, there[None], weights, 1, fit, stay_m2=reach**2, normals=glide)
    return fit


def correspondence(rest: RestMesh, model: BodyModel) -> Correspondence:
    """Where each vertex of a model lies on the mesh ``rest``; half a second.

    Raises:
        BodyModelError: the mesh is no body in a T-pose, or the model cannot be laid onto it.
    """
    _refuse_other_things(rest)
    with torch.no_grad():
        mean = model(*model.zero_pose()).vertices[0].double().cpu().numpy()
    normals = vertex_normals(mean, model.faces.cpu().numpy())
    ids = spread(model)
    fit = register(rest, model, Patches.of(model, ids), normals[ids])
    whole = Patches.of(model, np.arange(model.num_vertices))
    start, slopes = whole.linear(fit.world)
    laid = (start + (slopes @ fit.betas[:, None, :, None])[..., 0] + fit.transl[:, None])[0]
    surface = Surface(rest.vertices.astype(np.float64), rest.faces.astype(np.int64))
    on = surface.nearest(laid, vertex_normals(laid, model.faces.cpu().numpy()))
    sure = (on.distance < _NEAR_M) & (on.facing > _FACING) & model.outer.cpu().numpy()
    if sure[model.outer.cpu().numpy()].mean() < 0.5:
        raise BodyModelError(
            f"the body '{model.name}' cannot be laid onto the mesh '{rest.topology}': only {sure.mean():.0%} of its "
            "vertices find a counterpart; give the mesh in a T-pose (y up, facing +z, its left on +x), in metres"
        )
    return Correspondence(surface.faces[on.face], on.shares, sure)


def _begin(rest: RestMesh, model: BodyModel) -> Fit:
    """The model with its crown, fingertips and toes where those of the mesh are: arms and legs turned as a whole."""
    with torch.no_grad():
        mean = model(*model.zero_pose()).vertices[0].double().cpu().numpy()
    patches = Patches.of(model, _tips(mean))
    targets = rest.vertices[_tips(rest.vertices)].astype(np.float64)[None]
    weights = np.full((1, len(patches.ids)), 1 / _TIP_M**2)
    world = np.broadcast_to(np.eye(3), (1, 55, 3, 3)).copy()
    for _ in range(4):
        start, slopes = patches.linear(world)
        betas, transl = fit_shape(slopes, start, targets, weights)
        now = start + (slopes @ betas[:, None, :, None])[..., 0] + transl[:, None]
        roots = patches.bones.pose(world, betas, transl)[:, _LIMBS]
        turns = rotation_between(now[:, 1:] - roots, targets[:, 1:] - roots)
        for limb, turn in zip(_LIMBS, np.swapaxes(turns, 0, 1), strict=True):
            below = FAMILY[:, limb] > 0
            world[:, below] = turn[:, None] @ world[:, below]
    return Fit(world, betas, transl)


def _tips(points: NDArray[np.floating]) -> NDArray[np.int64]:
    """The crown, the fingertips and the tips of the feet of a T-pose (V, 3), left before right: five vertices."""
    x, y, z = points.T
    low = y < y.min() + 0.1 * np.ptp(y)
    middle = (x.min() + x.max()) / 2
    feet = [np.where(low & side, z, -np.inf).argmax() for side in (x > middle, x < middle)]
    return np.array([y.argmax(), x.argmax(), x.argmin(), *feet])


def _refuse_other_things(rest: RestMesh) -> None:
    low, high = rest.vertices.min(0), rest.vertices.max(0)
    wide, tall, deep = (float(v) for v in high - low)
    if not _STATURE_M[0] < tall < _STATURE_M[1] or not 0.6 * tall < wide < 1.6 * tall or deep > 0.6 * tall:
        raise BodyModelError(
            f"the mesh '{rest.topology}' is {wide:.3g} wide, {tall:.3g} high and {deep:.3g} deep, which is no body in "
            "a T-pose: give it in metres, y up, facing +z, arms stretched out sideways"
        )
