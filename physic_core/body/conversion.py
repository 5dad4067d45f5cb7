"""Bodies of one model as bodies of another, and contact on one mesh as contact on another: in closed form.

Betas of two models have nothing to do with each other, and their joints lie in other places of the same body. What two
bodies share is the surface, if its points can be told apart, and roughly their joints. So a body whose surface is known
is fitted by that; any other by its joints, with its rotations where both models share the T-pose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from physic_core.body import from_joints
from physic_core.body.bones import Bones, local_from_world, world_from_local
from physic_core.body.correspondence import Correspondence, correspondence
from physic_core.body.parameters import parameters_from_rotations, rotations_from_parameters
from physic_core.body.part_fit import Fit, fit_joints
from physic_core.body.surface_fit import SIGMA_M, Patches, fit_surface, spread
from physic_core.errors import BodyModelError
from physic_core.types import Bodies, BodyParameters, ContactProbability, Mesh, RestMesh

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel

Find = Callable[[RestMesh, "BodyModel"], Correspondence]
"""Where each vertex of a model lies on another mesh; one that keeps what was found will do."""

__all__ = ["Carried", "can_carry", "carry", "contact_to_model", "rest_mesh_of", "to_model"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Numbers = TypeVar("Numbers", bound=np.floating[Any])

_SHARED = ("embedded", "smpl", "smplx")
"""Models whose rotations are zero in the same T-pose."""
_OWN_SIGMA_M = 0.002
"""How far vertices may lie from those of the very same mesh, metres."""
_BODY = slice(0, 22)


@dataclass(frozen=True)
class Carried:
    """Bodies that were carried over to another model.

    Attributes:
        bodies: of that model, without joints and mesh; NaN throughout for people of whom too little is known.
        joints_m: (N,) mean distance of the known body joints, metres; a part of it is where two models put a joint.
        surface_m: (N,) mean distance of the surfaces, metres, or None where there is none to compare.
    """

    bodies: Bodies
    joints_m: Array
    surface_m: Array | None

    def note(self, before: str) -> str:
        """What became of bodies of the model ``before``, in plain words."""
        parts = []
        for name, apart in (("surface", self.surface_m), ("joints", self.joints_m)):
            known = apart[np.isfinite(apart)] if apart is not None else np.zeros(0)
            if len(known):
                parts.append(f"{name} within {1000 * float(known.mean()):.0f} mm")
        told = f", {' and '.join(parts)} on average" if parts else ""
        return f"bodies carried over from '{before}' to '{self.bodies.body_model}'{told}"


def can_carry(bodies: Bodies, model: BodyModel) -> bool:
    """Whether enough is told of bodies to carry them over to a model."""
    told = bodies.joints is not None or (bodies.mesh is not None and _tellable(bodies.mesh, model))
    return told or bodies.body_model in (model.name, "embedded")


def to_model(bodies: Bodies, model: BodyModel) -> Bodies:
    """Bodies of any model as bodies of this one; see :func:`carry`."""
    return carry(bodies, model).bodies


def carry(bodies: Bodies, model: BodyModel, find: Find = correspondence) -> Carried:
    """Bodies of any model as bodies of this one.

    Args:
        bodies: N people, those of whom nothing is known NaN.
        model: a body model on the CPU.

    Raises:
        BodyModelError: neither joints nor a surface whose points are known tell where these bodies are.
    """
    if bodies.body_model == model.name:
        return Carried(bodies, np.zeros(len(bodies.parameters)), None)
    if not can_carry(bodies, model):
        raise BodyModelError(
            f"bodies for the body model '{bodies.body_model}' cannot be carried over to '{model.name}': give the "
            "joints of SMPL-X (Bodies.joints), or a mesh with its T-pose (Bodies.mesh)"
        )
    joints, mesh = _whereabouts(bodies, model)
    known, sound = from_joints.numbers(joints), from_joints.numbers(_rotvecs(bodies.parameters))
    sound &= from_joints.enough(known) if mesh is None else from_joints.numbers(mesh.vertices.reshape(len(sound), -1))
    surface_m = None
    if not sound.any():
        fit = Fit(np.zeros((0, 55, 3, 3)), np.zeros((0, model.num_betas)), np.zeros((0, 3)))
    elif mesh is not None:
        fit, surface_m = _by_surface(model, replace(mesh, vertices=mesh.vertices[sound]), find)
    else:
        world = None
        if bodies.body_model in _SHARED:
            world = world_from_local(rotations_from_parameters(bodies.parameters[sound], dtype=torch.float64).numpy())
        fit = fit_joints(Bones.of(model), joints[sound], world)
    posed = Bones.of(model).pose(fit.world, fit.betas, fit.transl)[:, _BODY]
    apart = np.linalg.norm(posed - np.nan_to_num(joints[sound][:, _BODY]), axis=-1)
    seen = known[sound][:, _BODY]
    mean_apart = np.where(seen.any(1), (apart * seen).sum(1) / np.maximum(seen.sum(1), 1), np.nan)
    return Carried(
        Bodies(_as_parameters(fit, model, sound), model.name, bodies.observed),
        _spread_rows(mean_apart, sound),
        None if surface_m is None else _spread_rows(surface_m, sound),
    )


def contact_to_model(contact: ContactProbability, model: BodyModel, find: Find = correspondence) -> ContactProbability:
    """Probabilities of the vertices of any mesh as those of the vertices of a model; none in its cavities.

    Raises:
        BodyModelError: the mesh is not told (``rest``), or is no body in a T-pose.
    """
    if contact.topology == model.topology:
        return contact
    if contact.rest is None:
        raise BodyModelError(
            f"contact on the mesh '{contact.topology}' cannot be carried over to '{model.topology}': give the mesh in "
            "the T-pose (ContactProbability.rest)"
        )
    carried = find(contact.rest, model).carry(contact.probability[..., None])[..., 0]
    inner = ~model.outer.cpu().numpy()
    carried = np.where(inner & np.isfinite(carried), 0.0, carried)
    return ContactProbability(carried.astype(contact.probability.dtype), model.topology)


def with_joints(bodies: Bodies, model: BodyModel) -> Bodies:
    """Bodies of a model with the joints where it puts them, and without a mesh: for those who cannot load the model."""
    p = bodies.parameters
    given = (torch.from_numpy(np.array(value, np.float32)) for value in (p.betas, p.transl, p.expression))
    with torch.no_grad():
        joints = model(rotations_from_parameters(p), *given, joints_only=True).joints.cpu().numpy()
    return replace(bodies, joints=joints, mesh=None)


def rest_mesh_of(model: BodyModel) -> RestMesh:
    """The mean body of a model in its T-pose, without what lies in its cavities."""
    with torch.no_grad():
        vertices = model(*model.zero_pose()).vertices[0].cpu().numpy()
    return RestMesh(model.topology, vertices, model.faces.cpu().numpy())


def _tellable(mesh: Mesh, model: BodyModel) -> bool:
    """Whether it is known which point of the model's surface each point of the mesh is."""
    return mesh.rest is not None or _own(mesh, model)


def _own(mesh: Mesh, model: BodyModel) -> bool:
    return mesh.name in (model.topology, model.name) and mesh.vertices.shape[1] == model.num_vertices


def _whereabouts(bodies: Bodies, model: BodyModel) -> tuple[Array, Mesh | None]:
    """Joints (N, 55, 3), NaN where unknown, and the mesh if it tells anything of a model's surface.

    Of the embedded body both follow from its parameters.
    """
    joints = bodies.joints
    mesh = bodies.mesh if bodies.mesh is not None and _tellable(bodies.mesh, model) else None
    if bodies.body_model == "embedded" and joints is None and mesh is None:
        from physic_core.body import load_body

        own, p = load_body("embedded"), bodies.parameters
        with torch.no_grad():
            given = (torch.from_numpy(np.array(value, np.float32)) for value in (p.betas, p.transl))
            out = own(rotations_from_parameters(p), *given)
        rest = rest_mesh_of(own)
        joints = out.joints.numpy()
        mesh = Mesh(rest.topology, out.vertices.numpy(), rest.faces, rest.vertices)
    if joints is None:
        return np.full((len(bodies.parameters), 55, 3), np.nan), mesh
    return joints.astype(np.float64), mesh


def _by_surface(model: BodyModel, mesh: Mesh, find: Find) -> tuple[Fit, Array]:
    ids = spread(model)
    patches = Patches.of(model, ids)
    if _own(mesh, model):
        points, weights, sigma = mesh.vertices[:, ids].astype(np.float64), np.ones(len(ids)), _OWN_SIGMA_M
    else:
        assert mesh.rest is not None
        map_ = find(RestMesh(mesh.name, mesh.rest, mesh.faces), model).rows(ids)
        points, weights, sigma = map_.carry(mesh.vertices.astype(np.float64)), map_.sure.astype(np.float64), SIGMA_M
    fit = fit_surface(patches, points, np.broadcast_to(weights, points.shape[:2]), sigma_m=sigma)
    start, slopes = patches.linear(fit.world)
    now = start + (slopes @ fit.betas[:, None, :, None])[..., 0] + fit.transl[:, None]
    return fit, (np.linalg.norm(now - points, axis=-1) * weights).sum(1) / max(weights.sum(), 1.0)


def _rotvecs(parameters: BodyParameters) -> Array:
    """(N, 168) all that is a number of a body's pose and place."""
    p = parameters
    poses = (p.global_orient, p.body_pose, p.left_hand_pose, p.right_hand_pose, p.jaw_pose, p.leye_pose, p.reye_pose)
    return np.concatenate([*poses, p.transl], 1).astype(np.float64)


def _as_parameters(fit: Fit, model: BodyModel, rows: Bools) -> BodyParameters:
    """Of all people, NaN for those who were not fitted."""
    some = parameters_from_rotations(
        torch.from_numpy(local_from_world(fit.world)),
        torch.from_numpy(fit.betas),
        torch.zeros(len(fit.betas), model.num_expression),
        torch.from_numpy(fit.transl),
    )
    return BodyParameters(**{name: _spread_rows(value, rows) for name, value in vars(some).items()})


def _spread_rows(values: NDArray[Numbers], rows: Bools) -> NDArray[Numbers]:
    whole: NDArray[Numbers] = np.full((len(rows), *values.shape[1:]), np.nan, values.dtype)
    whole[rows] = values
    return whole
