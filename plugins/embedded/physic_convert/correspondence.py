"""Find the point correspondence between a body model and another mesh, from two T-poses.

The model is fitted to the other mesh, bone by bone, as in fits to posed surfaces. Then each vertex
is assigned the nearest surface point with a similar normal. No published correspondence file is
needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from physic_convert.joint_fit import BodyFit
from physic_convert.surface_fit import (
    SampledBodyModel,
    SurfaceTargets,
    fit_surface,
    sample_vertices,
)
from physic_core.body import ANCESTOR_MATRIX, fit_shape, joint_pair
from physic_core.errors import BodyModelError
from physic_core.geometry import cross, exact_arrays, rotation_between, unit, vertex_normals

if TYPE_CHECKING:
    from physic_core.body import BodyModel
    from physic_core.types import BoolArray, Float64Array, FloatArray, Int64Array, RestMesh


_NORMAL_M = 0.05
"""Distance in metres that counts as much as one radian between normals."""
_CANDIDATES = 12
"""Number of triangles with the nearest centres that are tested for each point."""

CORRESPONDENCE_VERSION = 1
"""Version of the algorithm for cache keys; increase it when results change."""

_MIN_FACING = 0.4
"""Minimum cosine between the normals of corresponding points."""


@dataclass(frozen=True)
class SurfacePoints:
    """Points on the triangles of a mesh, in barycentric coordinates.

    Attributes:
        face: (n,) int64.
        shares: (n, 3) of its three corners, not negative, with sum 1.
        distance: (n,) metres from the query point.
        facing: (n,) cosine between the normals.
    """

    face: Int64Array
    shares: Float64Array
    distance: Float64Array
    facing: Float64Array


class SurfaceIndex:
    """Search tree over the triangles of a mesh.

    Attributes:
        corners: (F, 3, 3) metres.
        normals: (F, 3) unit.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3).
    """

    def __init__(self, vertices: Float64Array, faces: Int64Array) -> None:
        self.faces = faces
        self.corners = vertices[faces]
        a, b, c = (self.corners[:, k] for k in range(3))
        self.normals = unit(cross(b - a, c - a))
        self._tree = cKDTree(np.concatenate([self.corners.mean(1), _NORMAL_M * self.normals], 1))

    def nearest(self, points: Float64Array, normals: Float64Array) -> SurfacePoints:
        """Find the nearest surface points for ``points`` (n, 3) with unit ``normals`` (n, 3)."""
        from trimesh.triangles import closest_point, points_to_barycentric

        features = np.concatenate([points, _NORMAL_M * normals], 1)
        _, candidates = self._tree.query(features, k=min(_CANDIDATES, len(self.faces)))
        candidates = candidates.reshape(len(points), -1)
        corners = self.corners[candidates]
        every = np.repeat(points, candidates.shape[1], axis=0)
        touched = closest_point(corners.reshape(-1, 3, 3), every).reshape(*candidates.shape, 3)
        apart = np.linalg.norm(touched - points[:, None], axis=-1)
        facing = (self.normals[candidates] * normals[:, None]).sum(-1)
        best = (apart + _NORMAL_M * (1 - facing)).argmin(1)
        row = np.arange(len(points))
        # Rounding gives points on an edge a share below 0.
        shares = points_to_barycentric(corners[row, best], touched[row, best]).clip(0)
        shares /= shares.sum(-1, keepdims=True)
        return SurfacePoints(candidates[row, best], shares, apart[row, best], facing[row, best])


@dataclass(frozen=True)
class Correspondence:
    """Position of each vertex of a body model on the surface of another mesh.

    Attributes:
        corners: (V, 3) int64 vertices of the other mesh.
        shares: (V, 3) barycentric coordinates, not negative, with sum 1.
        is_sure: (V,) bool, the point is near and its normal similar; elsewhere it is only the
            nearest one.
    """

    corners: Int64Array
    shares: Float64Array
    is_sure: BoolArray

    def interpolate(self, values: FloatArray) -> Float64Array:
        """Interpolate values (..., V_other, C) of the other mesh's vertices at the model's
        vertices: (..., V, C).
        """
        return sum(  # type: ignore[return-value]
            values[..., self.corners[:, k], :] * self.shares[:, k, None] for k in range(3)
        )

    def subset(self, ids: Int64Array) -> Correspondence:
        """Return the correspondence of the model's vertices ``ids`` (n,)."""
        return Correspondence(self.corners[ids], self.shares[ids], self.is_sure[ids])


_ROUNDS = 14

_DISTANCE_SIGMA_M = (0.25, 0.02)
"""Standard deviation of the distance weight in the first and in the last round, metres."""


def _register(
    fit: BodyFit, surface: SurfaceIndex, patches: SampledBodyModel, normals: Float64Array
) -> BodyFit:
    """Fit a body model to a mesh in the T-pose, by iterated closest points.

    Args:
        fit: the start.
        surface: of the mesh.
        patches: vertices of the model that are fitted.
        normals: (n, 3) of these in the T-pose.
    """
    for step, distance_sigma in enumerate(np.geomspace(*_DISTANCE_SIGMA_M, _ROUNDS)):
        turns = (patches.weights @ fit.world[0].reshape(-1, 9)).reshape(-1, 3, 3)
        facing = (turns @ normals[..., None])[..., 0]
        on = surface.nearest(patches.posed(fit)[0], facing)
        targets = (on.shares[..., None] * surface.corners[on.face]).sum(1)
        weights = ((on.facing > _MIN_FACING) * np.exp(-0.5 * (on.distance / distance_sigma) ** 2))[
            None
        ]
        # At large distances, limbs move before single bones. In later rounds, vertices may slide
        # along the surface.
        glide = surface.normals[on.face][None] if step >= _ROUNDS // 3 else None
        fit = fit_surface(
            patches,
            SurfaceTargets(targets[None], weights, glide),
            1,
            fit,
            stay_m2=distance_sigma**2,
        )
    return fit


_MAX_DISTANCE_M = 0.03
"""Maximum distance of a vertex from its counterpart, metres."""


def find_correspondence(rest: RestMesh, model: BodyModel) -> Correspondence:
    """Find the position of each vertex of a model on the mesh ``rest``; takes half a second.

    Raises:
        BodyModelError: the mesh is not a body in a T-pose, or the model cannot be fitted to it.
    """
    _check_body_extent(rest)
    (mean,) = exact_arrays(model(*model.zero_pose()).vertices[0])
    faces, outer = exact_arrays(model.faces, model.outer)
    ids = sample_vertices(model)
    surface = SurfaceIndex(rest.vertices.astype(np.float64), rest.faces.astype(np.int64))
    fit = _register(
        _align_tips(rest.vertices, SampledBodyModel.of(model, _tip_vertices(mean))),
        surface,
        SampledBodyModel.of(model, ids),
        vertex_normals(mean, faces)[ids],
    )
    laid = SampledBodyModel.of(model, np.arange(model.num_vertices)).posed(fit)[0]
    on = surface.nearest(laid, vertex_normals(laid, faces))
    is_sure = (on.distance < _MAX_DISTANCE_M) & (on.facing > _MIN_FACING) & outer
    if is_sure[outer].mean() < 0.5:
        raise BodyModelError(
            f"the body '{model.name}' cannot be fitted to the mesh '{rest.topology}': only "
            f"{is_sure.mean():.0%} of its vertices have a counterpart; give the mesh in a T-pose "
            "(y up, facing +z, its left on +x), in meters"
        )
    return Correspondence(surface.faces[on.face], on.shares, is_sure)


_TIP_SIGMA_M = 0.03
"""Standard deviation of the distance between the tips of limbs and crowns of two bodies, metres."""

_LIMBS = [*joint_pair("shoulder"), *joint_pair("hip")]
"""Root joints of the limbs, in the order of their tips."""


def _align_tips(vertices: FloatArray, patches: SampledBodyModel) -> BodyFit:
    """Fit crown, fingertips and toes of a model, ``patches``, to those of a mesh (V, 3), with rigid
    arms and legs.
    """
    targets = vertices[_tip_vertices(vertices)].astype(np.float64)[None]
    weights = np.full((1, len(patches.ids)), 1 / _TIP_SIGMA_M**2)
    world = np.broadcast_to(np.eye(3), (1, 55, 3, 3)).copy()
    for _ in range(4):
        start, slopes = patches.linear(world)
        betas, transl = fit_shape(slopes, start, targets, weights)
        now = start + (slopes @ betas[:, None, :, None])[..., 0] + transl[:, None]
        roots = patches.bones.pose(world, betas, transl)[:, _LIMBS]
        turns = rotation_between(now[:, 1:] - roots, targets[:, 1:] - roots)
        for limb, turn in zip(_LIMBS, np.swapaxes(turns, 0, 1), strict=True):
            below = ANCESTOR_MATRIX[:, limb] > 0
            world[:, below] = turn[:, None] @ world[:, below]
    return BodyFit(world, betas, transl)


def _tip_vertices(points: FloatArray) -> Int64Array:
    """Return the vertex ids of the crown, the fingertips and the toes of a T-pose (V, 3), left
    before right.
    """
    x, y, z = points.T
    low = y < y.min() + 0.1 * np.ptp(y)
    middle = (x.min() + x.max()) / 2
    feet = [np.where(low & side, z, -np.inf).argmax() for side in (x > middle, x < middle)]
    return np.array([y.argmax(), x.argmax(), x.argmin(), *feet])


_STATURE_M = (0.3, 3.0)


def _check_body_extent(rest: RestMesh) -> None:
    """Raise BodyModelError if the extent of a mesh is not that of a body in a T-pose."""
    low = rest.vertices.min(0)
    high = rest.vertices.max(0)
    wide, tall, deep = (float(v) for v in high - low)
    if (
        not _STATURE_M[0] < tall < _STATURE_M[1]
        or not 0.6 * tall < wide < 1.6 * tall
        or deep > 0.6 * tall
    ):
        raise BodyModelError(
            f"the mesh '{rest.topology}' is {wide:.3g} wide, {tall:.3g} high and {deep:.3g} deep, "
            "which is not a body in a T-pose: give it in meters, y up, facing +z, arms stretched "
            "out sideways"
        )
