"""Build a BodyModel from the NumPy arrays of an asset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physic_core.body.joints import PARENTS, PART_NAMES
from physic_core.body.model import BodyModel
from physic_core.body.posing import Kinematics, Skin

_Array = NDArray[Any]
_NUM_CROWN, _NUM_GROUND = 40, 400
"""Number of candidate vertices for the highest and for the lowest point of any shape."""


@dataclass(frozen=True)
class VertexSets:
    """Named vertex sets of one mesh topology; all ids int64, ascending.

    Attributes:
        part_of_vertex: (V,) index into PART_NAMES.
        contact_sets: name in CONTACT_SETS -> ids.
        surface_points: name in SURFACE_POINTS -> ids.
        extremes: ids that can be the highest or the lowest point in the T-pose.
    """

    part_of_vertex: _Array
    contact_sets: Mapping[str, _Array]
    surface_points: Mapping[str, _Array]
    extremes: _Array


@dataclass(frozen=True)
class BodyArrays:
    """Arrays of a body model asset, in metres; named as in BodyModel, Kinematics and Skin.

    Attributes:
        template: (V, 3).
        directions: (D, V, 3): K shape rows, E expression rows, then 486 pose rows or none.
        joint_template: (55, 3).
        joint_directions: (K + E, 55, 3).
        bind_rot: (55, 3, 3), or None.
        weights: (V, 55).
        faces: (F, 3).
        outer: (V,) bool.
        picks: None to derive them from the geometry.
    """

    name: str
    topology: str
    template: _Array
    directions: _Array
    joint_template: _Array
    joint_directions: _Array
    bind_rot: _Array | None
    weights: _Array
    faces: _Array
    num_betas: int
    num_expression: int
    outer: _Array
    picks: VertexSets | None = None
    info: str = ""


def build_body_model(arrays: BodyArrays, device: torch.device | str = "cpu") -> BodyModel:
    """Build a BodyModel, float32, on a device."""
    picks = derive_vertex_sets(arrays) if arrays.picks is None else arrays.picks
    kinematics, skin = _mechanics(arrays)
    model = BodyModel(
        name=arrays.name,
        topology=arrays.topology,
        faces=torch.as_tensor(arrays.faces.astype(np.int64)),
        num_betas=arrays.num_betas,
        num_expression=arrays.num_expression,
        part_names=PART_NAMES,
        part_of_vertex=torch.as_tensor(picks.part_of_vertex.astype(np.int64)),
        contact_sets=_ids(picks.contact_sets),
        outer=torch.as_tensor(arrays.outer),
        surface_points=_ids(picks.surface_points),
        kinematics=kinematics,
        skin=skin,
        extremes=torch.as_tensor(picks.extremes.astype(np.int64)),
        info=arrays.info,
    )
    return model.to(device)


def derive_vertex_sets(arrays: BodyArrays) -> VertexSets:
    """Derive body parts, contact sets and landmarks of the mean body from its geometry and skinning weights."""
    from physic_core.body.parts import TPoseMesh, contact_set_vertices, label_parts, pick_surface_points

    kinematics, skin = _mechanics(arrays)
    none = torch.zeros(1, 0)
    world, skinning = kinematics.transforms(torch.eye(3).repeat(1, 55, 1, 1), kinematics.rest_joints(none))
    mesh = TPoseMesh(
        vertices=skin.pose(none, skinning)[0].double().numpy(),
        faces=arrays.faces.astype(np.int64),
        joints=world[0, :, :, 3].double().numpy(),
        weights=arrays.weights.astype(np.float64),
        outer=arrays.outer,
    )
    by_height = np.argsort(mesh.vertices[:, 1], kind="stable")
    extremes = np.unique(np.concatenate([by_height[:_NUM_GROUND], by_height[-_NUM_CROWN:]]))
    return VertexSets(label_parts(mesh.weights), contact_set_vertices(mesh), pick_surface_points(mesh), extremes)


def _mechanics(arrays: BodyArrays) -> tuple[Kinematics, Skin]:
    """Build the Kinematics and the Skin of an asset."""
    bind_rot = None if arrays.bind_rot is None else _float(arrays.bind_rot)
    kinematics = Kinematics.build(_float(arrays.joint_template), _float(arrays.joint_directions), bind_rot, PARENTS)
    skin = Skin(
        _float(arrays.template).T.contiguous(),
        _float(arrays.directions).transpose(1, 2).contiguous(),
        _float(arrays.weights).T.contiguous(),
    )
    return kinematics, skin


def _float(array: _Array) -> Tensor:
    """Convert an array to a float32 tensor."""
    return torch.as_tensor(np.asarray(array, dtype=np.float32))


def _ids(groups: Mapping[str, _Array]) -> dict[str, Tensor]:
    """Convert id arrays to int64 tensors."""
    return {name: torch.as_tensor(ids.astype(np.int64)) for name, ids in groups.items()}
