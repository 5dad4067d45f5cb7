"""Convert bodies to another body model, and contact to another mesh, in closed form.

The betas of two models are unrelated, and their joints are at different places of the same body.
The surface is comparable if its point correspondence is known, the joints are roughly comparable.
So bodies with a known surface are fitted to it, all others to their joints, with their rotations if
both models have the same T-pose.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from physic_convert.correspondence_cache import cached_correspondence
from physic_convert.joint_fit import BodyFit, finite_rows, fit_joints, has_torso_joints
from physic_convert.surface_fit import (
    SURFACE_SIGMA_M,
    SampledBodyModel,
    SurfaceTargets,
    fit_surface,
    sample_vertices,
)
from physic_core.body import (
    JOINT_INDEX,
    NUM_JOINTS,
    ROTATION_FIELDS,
    BoneOffsets,
    parameters_from_rotations,
    pose_from_parameters,
    rotations_from_parameters,
    rotations_from_parents,
    rotations_from_tpose,
)
from physic_core.conversion import BodyConverter, ConvertedBodies, has_topology, mesh_to_fit
from physic_core.types import Bodies, BodyParameters, ContactProbability, Mesh, RestMesh

if TYPE_CHECKING:
    from physic_core.body import BodyModel
    from physic_core.conversion import VertexTransfer
    from physic_core.types import BoolArray, Float64Array

_Numbers = TypeVar("_Numbers", bound=np.floating[Any])

_SHARED = ("embedded", "smpl", "smplx")
"""Body models with the same T-pose at zero rotations."""
_OWN_SIGMA_M = 0.002
"""Standard deviation of vertices from those of an identical mesh, metres."""
_BODY = slice(0, JOINT_INDEX["right_wrist"] + 1)


class ClosedForm(BodyConverter):
    """Fits of surfaces with a known correspondence, else of joints, in closed form."""

    def convert(self, bodies: Bodies, model: BodyModel) -> ConvertedBodies:
        """Fit the model to the surfaces of people, or to their joints."""
        return _converted(bodies, model)

    def vertex_transfer(self, rest: RestMesh, model: BodyModel) -> VertexTransfer:
        """Return the interpolation at the position of each vertex on the mesh."""
        return cached_correspondence(rest, model).interpolate

    def convert_contact(self, contact: ContactProbability, model: BodyModel) -> ContactProbability:
        """Interpolate contact at the position of each vertex; 0 in cavities of the body."""
        assert contact.rest is not None
        correspondence = cached_correspondence(contact.rest, model)
        probability = correspondence.interpolate(contact.probability[..., None])[..., 0]
        inner = ~model.outer.numpy()
        probability = np.where(inner & np.isfinite(probability), 0.0, probability)
        return ContactProbability(probability.astype(contact.probability.dtype), model.topology)


def _converted(bodies: Bodies, model: BodyModel) -> ConvertedBodies:
    joints, mesh = _joints_and_mesh(bodies, model)
    p = bodies.parameters
    pose = [*(getattr(p, name) for name, _ in ROTATION_FIELDS), p.transl]
    known = finite_rows(joints)
    usable = finite_rows(np.concatenate(pose, 1))
    usable &= (
        has_torso_joints(known)
        if mesh is None
        else finite_rows(mesh.vertices.reshape(len(usable), -1))
    )
    fit, surface_m = _fit(bodies, model, joints, mesh, usable)
    posed = BoneOffsets.of(model).pose(fit.world, fit.betas, fit.transl)[:, _BODY]
    apart = np.linalg.norm(posed - np.nan_to_num(joints[usable][:, _BODY]), axis=-1)
    measured = known[usable][:, _BODY]
    mean_apart = np.where(
        measured.any(1), (apart * measured).sum(1) / np.maximum(measured.sum(1), 1), np.nan
    )
    parameters = _fit_to_parameters(fit, model, usable)
    return ConvertedBodies(
        replace(bodies, parameters=parameters, body_model=model.name, joints=None, mesh=None),
        _spread_rows(mean_apart, usable),
        None if surface_m is None else _spread_rows(surface_m, usable),
    )


def _fit(
    bodies: Bodies,
    model: BodyModel,
    joints: Float64Array,
    mesh: Mesh | None,
    rows: BoolArray,
) -> tuple[BodyFit, Float64Array | None]:
    """Return the fits to chosen people's meshes, with mean distances, or to their joints."""
    if not rows.any():
        none = np.zeros((0, NUM_JOINTS, 3, 3)), np.zeros((0, model.num_betas)), np.zeros((0, 3))
        return BodyFit(*none), None
    if mesh is not None:
        return _fit_to_surface(model, replace(mesh, vertices=mesh.vertices[rows]))
    world = None
    if bodies.body_model in _SHARED:
        turns = rotations_from_parameters(bodies.parameters[rows], dtype=torch.float64)
        world = rotations_from_tpose(turns.numpy())
    return fit_joints(BoneOffsets.of(model), joints[rows], world), None


def _joints_and_mesh(bodies: Bodies, model: BodyModel) -> tuple[Float64Array, Mesh | None]:
    """Return the joints (N, 55, 3), NaN where unknown, and the mesh if it has a known
    correspondence.

    For the embedded body, both follow from its parameters.
    """
    joints = bodies.joints
    mesh = mesh_to_fit(bodies, model)
    if bodies.body_model == "embedded" and joints is None and mesh is None:
        from physic_core.body import load_body, rest_mesh_of_model

        embedded = load_body()
        with torch.no_grad():
            out = embedded(*pose_from_parameters(bodies.parameters)[:3])
        rest = rest_mesh_of_model(embedded)
        joints = out.joints.numpy()
        mesh = Mesh(rest.topology, out.vertices.numpy(), rest.faces, rest.vertices)
    if joints is None:
        return np.full((len(bodies.parameters), NUM_JOINTS, 3), np.nan), mesh
    return joints.astype(np.float64), mesh


def _fit_to_surface(model: BodyModel, mesh: Mesh) -> tuple[BodyFit, Float64Array]:
    """Fit the model to posed meshes; return the fit and the mean distance (N,) in metres."""
    ids = sample_vertices(model)
    patches = SampledBodyModel.of(model, ids)
    if has_topology(mesh, model):
        points = mesh.vertices[:, ids].astype(np.float64)
        weights = np.ones(len(ids))
        sigma = _OWN_SIGMA_M
    else:
        assert mesh.rest is not None
        map_ = cached_correspondence(RestMesh(mesh.name, mesh.rest, mesh.faces), model).subset(ids)
        points = map_.interpolate(mesh.vertices.astype(np.float64))
        weights = map_.is_sure.astype(np.float64)
        sigma = SURFACE_SIGMA_M
    fit = fit_surface(
        patches, SurfaceTargets(points, np.broadcast_to(weights, points.shape[:2])), sigma_m=sigma
    )
    return fit, (np.linalg.norm(patches.posed(fit) - points, axis=-1) * weights).sum(1) / max(
        weights.sum(), 1.0
    )


def _fit_to_parameters(fit: BodyFit, model: BodyModel, rows: BoolArray) -> BodyParameters:
    """Convert a fit to parameters of all people, NaN for those that were not fitted."""
    some = parameters_from_rotations(
        torch.from_numpy(rotations_from_parents(fit.world)),
        torch.from_numpy(fit.betas),
        torch.zeros(len(fit.betas), model.num_expression),
        torch.from_numpy(fit.transl),
    )
    return BodyParameters(**{name: _spread_rows(value, rows) for name, value in vars(some).items()})


def _spread_rows(values: NDArray[_Numbers], rows: BoolArray) -> NDArray[_Numbers]:
    """Insert values into the selected rows of a NaN array."""
    rows_of_all: NDArray[_Numbers] = np.full((len(rows), *values.shape[1:]), np.nan, values.dtype)
    rows_of_all[rows] = values
    return rows_of_all
