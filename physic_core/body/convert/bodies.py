"""Convert bodies to another body model, and contact to another mesh, in closed form.

The betas of two models are unrelated, and their joints are at different places of the same body.
The surface is comparable if its point correspondence is known, the joints are roughly comparable.
So bodies with a known surface are fitted to it, all others to their joints, with their rotations if
both models have the same T-pose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from physic_core.body.bones import (
    BoneOffsets,
    parameters_from_rotations,
    pose_from_parameters,
    rotations_from_parameters,
    rotations_from_parents,
    rotations_from_tpose,
)
from physic_core.body.convert.correspondence import Correspondence, find_correspondence
from physic_core.body.convert.joint_fit import BodyFit, finite_rows, fit_joints, has_torso_joints
from physic_core.body.convert.surface_fit import (
    SURFACE_SIGMA_M,
    SampledBodyModel,
    SurfaceTargets,
    fit_surface,
    sample_vertices,
)
from physic_core.body.joints import JOINT_INDEX, NUM_JOINTS, ROTATION_FIELDS
from physic_core.errors import BodyModelError
from physic_core.types import Bodies, BodyParameters, ContactProbability, Mesh, RestMesh

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel

_FindCorrespondence = Callable[[RestMesh, "BodyModel"], Correspondence]
"""Function that finds the position of each model vertex on another mesh; it may cache results."""

_Array = NDArray[np.float64]
_Bools = NDArray[np.bool_]
_Numbers = TypeVar("_Numbers", bound=np.floating[Any])

_SHARED = ("embedded", "smpl", "smplx")
"""Body models with the same T-pose at zero rotations."""
_OWN_SIGMA_M = 0.002
"""Standard deviation of vertices from those of an identical mesh, metres."""
_BODY = slice(0, JOINT_INDEX["right_wrist"] + 1)


@dataclass(frozen=True)
class ConvertedBodies:
    """Bodies after conversion to another model, with the residuals of the fit.

    Attributes:
        bodies: of the new model, without joints and mesh; all NaN for people with too few known
            joints.
        joints_m: (N,) mean distance of the known body joints, metres; it includes the difference of
            joint definitions.
        surface_m: (N,) mean distance of the surfaces, metres, or None without a mesh.
    """

    bodies: Bodies
    joints_m: _Array
    surface_m: _Array | None

    def note(self, before: str) -> str:
        """Return a note for the user: both body models and the mean residuals."""
        parts = []
        for name, apart in (("surface", self.surface_m), ("joints", self.joints_m)):
            known = apart[np.isfinite(apart)] if apart is not None else np.zeros(0)
            if len(known):
                parts.append(f"{name} within {1000 * float(known.mean()):.0f} mm")
        residuals = f", {' and '.join(parts)} on average" if parts else ""
        return f"bodies converted from '{before}' to '{self.bodies.body_model}'{residuals}"


def can_convert(bodies: Bodies, model: BodyModel) -> bool:
    """Return whether bodies have the joints or the mesh that a conversion to ``model`` needs."""
    known = bodies.joints is not None or _mesh_to_fit(bodies, model) is not None
    return known or bodies.body_model in (model.name, "embedded")


def convert_with_residuals(
    bodies: Bodies, model: BodyModel, find: _FindCorrespondence = find_correspondence
) -> ConvertedBodies:
    """Convert bodies to another body model, and return the residuals of the fit.

    Args:
        bodies: of N people; NaN for people without an estimate.
        model: a body model on the CPU.

    Raises:
        BodyModelError: the bodies have neither joints nor a mesh with a known correspondence.
    """
    if bodies.body_model == model.name:
        return ConvertedBodies(bodies, np.zeros(len(bodies.parameters)), None)
    if not can_convert(bodies, model):
        raise BodyModelError(
            f"bodies for the body model '{bodies.body_model}' cannot be converted to "
            f"'{model.name}': give the joints of SMPL-X (Bodies.joints), or a mesh with its T-pose "
            "(Bodies.mesh)"
        )
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
    fit, surface_m = _fit(bodies, model, joints, mesh, usable, find)
    posed = BoneOffsets.of(model).pose(fit.world, fit.betas, fit.transl)[:, _BODY]
    apart = np.linalg.norm(posed - np.nan_to_num(joints[usable][:, _BODY]), axis=-1)
    seen = known[usable][:, _BODY]
    mean_apart = np.where(seen.any(1), (apart * seen).sum(1) / np.maximum(seen.sum(1), 1), np.nan)
    parameters = _fit_to_parameters(fit, model, usable)
    return ConvertedBodies(
        replace(bodies, parameters=parameters, body_model=model.name, joints=None, mesh=None),
        _spread_rows(mean_apart, usable),
        None if surface_m is None else _spread_rows(surface_m, usable),
    )


def _fit(
    bodies: Bodies,
    model: BodyModel,
    joints: _Array,
    mesh: Mesh | None,
    rows: _Bools,
    find: _FindCorrespondence,
) -> tuple[BodyFit, _Array | None]:
    """Return the fits to chosen people's meshes, with mean distances, or to their joints."""
    if not rows.any():
        none = np.zeros((0, NUM_JOINTS, 3, 3)), np.zeros((0, model.num_betas)), np.zeros((0, 3))
        return BodyFit(*none), None
    if mesh is not None:
        return _fit_to_surface(model, replace(mesh, vertices=mesh.vertices[rows]), find)
    world = None
    if bodies.body_model in _SHARED:
        turns = rotations_from_parameters(bodies.parameters[rows], dtype=torch.float64)
        world = rotations_from_tpose(turns.numpy())
    return fit_joints(BoneOffsets.of(model), joints[rows], world), None


def convert_contact(
    contact: ContactProbability, model: BodyModel, find: _FindCorrespondence = find_correspondence
) -> ContactProbability:
    """Transfer contact probabilities to the vertices of a body model; 0 in its cavities.

    Raises:
        BodyModelError: the rest mesh is missing, or is not a body in a T-pose.
    """
    if contact.topology == model.topology:
        return contact
    if contact.rest is None:
        raise BodyModelError(
            f"contact on the mesh '{contact.topology}' cannot be converted to '{model.topology}': "
            "give the mesh in the T-pose (ContactProbability.rest)"
        )
    probability = find(contact.rest, model).interpolate(contact.probability[..., None])[..., 0]
    inner = ~model.outer.cpu().numpy()
    probability = np.where(inner & np.isfinite(probability), 0.0, probability)
    return ContactProbability(probability.astype(contact.probability.dtype), model.topology)


def replace_mesh_with_joints(bodies: Bodies, model: BodyModel) -> Bodies:
    """Return bodies with the posed joints of their body model, and without a mesh."""
    with torch.no_grad():
        joints = model(*pose_from_parameters(bodies.parameters), joints_only=True).joints
    return replace(bodies, joints=joints.cpu().numpy(), mesh=None)


def rest_mesh_of_model(model: BodyModel) -> RestMesh:
    """Return the mesh of the mean body of a model in its T-pose."""
    with torch.no_grad():
        vertices = model(*model.zero_pose()).vertices[0].cpu().numpy()
    return RestMesh(model.topology, vertices, model.faces.cpu().numpy())


def _mesh_to_fit(bodies: Bodies, model: BodyModel) -> Mesh | None:
    """Return the mesh of bodies if its correspondence to the model's surface can be found."""
    mesh = bodies.mesh
    if mesh is None or (mesh.rest is None and not _same_topology(mesh, model)):
        return None
    return mesh


def _same_topology(mesh: Mesh, model: BodyModel) -> bool:
    """Return whether the mesh has the model's topology."""
    return (
        mesh.name in (model.topology, model.name) and mesh.vertices.shape[1] == model.num_vertices
    )


def _joints_and_mesh(bodies: Bodies, model: BodyModel) -> tuple[_Array, Mesh | None]:
    """Return the joints (N, 55, 3), NaN where unknown, and the mesh if it has a known
    correspondence.

    For the embedded body, both follow from its parameters.
    """
    joints = bodies.joints
    mesh = _mesh_to_fit(bodies, model)
    if bodies.body_model == "embedded" and joints is None and mesh is None:
        from physic_core.body.files import load_embedded

        own = load_embedded("cpu")
        with torch.no_grad():
            out = own(*pose_from_parameters(bodies.parameters)[:3])
        rest = rest_mesh_of_model(own)
        joints = out.joints.numpy()
        mesh = Mesh(rest.topology, out.vertices.numpy(), rest.faces, rest.vertices)
    if joints is None:
        return np.full((len(bodies.parameters), NUM_JOINTS, 3), np.nan), mesh
    return joints.astype(np.float64), mesh


def _fit_to_surface(
    model: BodyModel, mesh: Mesh, find: _FindCorrespondence
) -> tuple[BodyFit, _Array]:
    """Fit the model to posed meshes; return the fit and the mean distance (N,) in metres."""
    ids = sample_vertices(model)
    patches = SampledBodyModel.of(model, ids)
    if _same_topology(mesh, model):
        points = mesh.vertices[:, ids].astype(np.float64)
        weights = np.ones(len(ids))
        sigma = _OWN_SIGMA_M
    else:
        assert mesh.rest is not None
        map_ = find(RestMesh(mesh.name, mesh.rest, mesh.faces), model).subset(ids)
        points = map_.interpolate(mesh.vertices.astype(np.float64))
        weights = map_.sure.astype(np.float64)
        sigma = SURFACE_SIGMA_M
    fit = fit_surface(
        patches, SurfaceTargets(points, np.broadcast_to(weights, points.shape[:2])), sigma_m=sigma
    )
    return fit, (np.linalg.norm(patches.posed(fit) - points, axis=-1) * weights).sum(1) / max(
        weights.sum(), 1.0
    )


def _fit_to_parameters(fit: BodyFit, model: BodyModel, rows: _Bools) -> BodyParameters:
    """Convert a fit to parameters of all people, NaN for those that were not fitted."""
    some = parameters_from_rotations(
        torch.from_numpy(rotations_from_parents(fit.world)),
        torch.from_numpy(fit.betas),
        torch.zeros(len(fit.betas), model.num_expression),
        torch.from_numpy(fit.transl),
    )
    return BodyParameters(**{name: _spread_rows(value, rows) for name, value in vars(some).items()})


def _spread_rows(values: NDArray[_Numbers], rows: _Bools) -> NDArray[_Numbers]:
    """Insert values into the selected rows of a NaN array."""
    rows_of_all: NDArray[_Numbers] = np.full((len(rows), *values.shape[1:]), np.nan, values.dtype)
    rows_of_all[rows] = values
    return rows_of_all
