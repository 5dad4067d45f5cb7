"""Body model with linear blend skinning, for the embedded body and for SMPL-X files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from physic_core.body.arrays import BodyArrays, VertexSets
from physic_core.body.joints import NUM_JOINTS, PARENTS, PART_NAMES
from physic_core.body.landmarks import (
    LandmarkRegressor,
    TPoseMesh,
    contact_set_vertices,
    pick_surface_points,
    skeleton_regressor,
)
from physic_core.body.posing import JointTree, Kinematics, Skin, pose_vertices
from physic_core.errors import BodyModelError
from physic_core.geometry.mesh import CoarseMesh, coarse_mesh, faces_of_vertices
from physic_core.geometry.tensors import to_dtype
from physic_core.types.arrays import PER_PERSON
from physic_core.types.bodies import RestMesh
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import Skeleton, skeleton_named

if TYPE_CHECKING:
    from physic_core.types import AnyArray


_COARSE_M = 0.02


@dataclass(frozen=True, eq=False)
class BodyOutput(ShortRepr):
    """Vertices, joints and bone rotations of posed bodies, metres.

    Attributes:
        vertices: (B, V, 3); (B, n, 3) for a subset of n vertices; (B, 0, 3) for joints only.
        joints: (B, 55, 3).
        world: (B, 55, 3, 3) rotation of each bone against the T-pose.
    """

    vertices: Tensor = field(metadata=PER_PERSON)
    joints: Tensor = field(metadata=PER_PERSON)
    world: Tensor = field(metadata=PER_PERSON)


@dataclass(frozen=True, eq=False, repr=False)
class BodyModel:
    """Body model with SMPL-X joints: zero rotations are a T-pose, y up, facing +z, left on +x.

    The root turns about the pelvis joint and ``transl`` is added after posing. Everything is
    differentiable; the float type is that of the asset (:meth:`to`).

    Attributes:
        name: "embedded" or "smplx"; their parameters are not interchangeable.
        topology: name of the mesh, "physic-embedded-1" or "smplx".
        faces: (F, 3) int64, counter-clockwise seen from outside.
        num_betas: K, how many shape components it takes.
        num_expression: E, how many expression components it takes.
        part_names: names of the body parts.
        part_of_vertex: (V,) int64, index into ``part_names``.
        contact_sets: name -> (n,) int64 vertex ids that often are in contact with the scene.
        outer: (V,) bool, False in the cavities of mouth, nose and eyes, which have no contact.
        kinematics: rest joints and forward kinematics.
        skin: blend shapes and skinning weights; the directions are shape, expression, then pose
            correctives.
        surface_points: landmark -> (n,) int64 vertex ids; the landmark is their mean.
        extremes: (n,) int64 vertices that can be the highest or the lowest point in the T-pose.
        regressors: skeletons that the asset defines; those of others follow from
            ``surface_points``.
        info: source and licence of the asset, in words.
    """

    name: str
    topology: str
    faces: Tensor
    num_betas: int
    num_expression: int
    part_names: tuple[str, ...]
    part_of_vertex: Tensor
    contact_sets: Mapping[str, Tensor]
    outer: Tensor
    kinematics: Kinematics
    skin: Skin
    surface_points: Mapping[str, Tensor]
    extremes: Tensor
    regressors: Mapping[Skeleton, LandmarkRegressor] = field(default_factory=dict)
    info: str = ""

    def __repr__(self) -> str:
        return (
            f"BodyModel({self.name}, {self.num_vertices} vertices, {self.num_betas} betas, "
            f"{self.dtype})"
        )

    @property
    def num_vertices(self) -> int:
        """Number of vertices V."""
        return self.skin.num_vertices

    @property
    def soles(self) -> Tensor:
        """Vertices (S,) int64 of both soles."""
        return torch.cat([self.contact_sets["left_sole"], self.contact_sets["right_sole"]])

    def contact_set_mask(self, *names: str) -> Tensor:
        """Return the vertices (V,) bool of contact sets."""
        chosen = torch.zeros_like(self.outer)
        for name in names:
            chosen[self.contact_sets[name]] = True
        return chosen

    def part_mask(self, *endings: str) -> Tensor:
        """Return the vertices (V,) bool of body parts whose names have one of these endings."""
        chosen = torch.tensor([name.endswith(endings) for name in self.part_names])
        return chosen[self.part_of_vertex]

    @property
    def dtype(self) -> torch.dtype:
        """Float type of the asset."""
        return self.skin.template.dtype

    @cached_property
    def faces_of_vertices(self) -> Tensor:
        """(V, most) int64 indices of the faces at each vertex, padded with F."""
        return faces_of_vertices(self.faces, self.num_vertices)

    @cached_property
    def double(self) -> BodyModel:
        """The model in float64, with its own cached properties."""
        return self if self.dtype == torch.float64 else self.to(dtype=torch.float64)

    @cached_property
    def coarse(self) -> CoarseMesh:
        """Decimated mesh with a quarter of the vertices, 2 cm apart, for visibility tests."""
        return coarse_mesh(self.skin.template.T, self.faces, self.part_of_vertex, _COARSE_M)

    def to(self, dtype: torch.dtype) -> BodyModel:
        """Return a copy in another float type."""
        return to_dtype(self, dtype)

    def __call__(
        self,
        rotations: Tensor,
        betas: Tensor,
        transl: Tensor,
        expression: Tensor | None = None,
        *,
        vertex_ids: Tensor | None = None,
        joints_only: bool = False,
    ) -> BodyOutput:
        """Pose B bodies and return their vertices and joints.

        Args:
            rotations: (B, 55, 3, 3) of each joint relative to its parent.
            betas: (B, K) shape.
            transl: (B, 3) metres.
            expression: (B, E); None for zero.
            vertex_ids: (n,) int64, to pose only these vertices. To pose the same few many times use
                :meth:`landmarks_only`, which gathers them once.
            joints_only: skip the vertices.

        Raises:
            BodyModelError: a shape does not fit this body.
        """
        self._check(rotations, betas, transl, expression)
        coefficients = _coefficients(self.num_expression, betas, expression)
        world, skinning = self.kinematics.transforms(
            rotations, self.kinematics.rest_joints(coefficients)
        )
        joints = world[..., 3] + transl[:, None]
        if joints_only:
            return BodyOutput(rotations.new_zeros(len(rotations), 0, 3), joints, world[..., :3])
        skin = self.skin if vertex_ids is None else self.skin.subset(vertex_ids)
        vertices = (
            skin.pose(skin.with_correctives(coefficients, rotations), skinning) + transl[:, None]
        )
        return BodyOutput(vertices, joints, world[..., :3])

    def zero_pose(self, batch: int = 1) -> tuple[Tensor, Tensor, Tensor]:
        """Return rotations (B, 55, 3, 3), betas (B, K) and transl (B, 3) of the mean body in its
        T-pose.
        """
        like = self.skin.template
        eye = torch.eye(3, dtype=like.dtype)
        return (
            eye.repeat(batch, NUM_JOINTS, 1, 1),
            like.new_zeros(batch, self.num_betas),
            like.new_zeros(batch, 3),
        )

    def regressor(self, skeleton: Skeleton | str) -> LandmarkRegressor:
        """Return the linear map from joints and vertices to the keypoints of a skeleton.

        Raises:
            BodyModelError: no standard skeleton has this name, or a point does not lie on a body.
        """
        try:
            skeleton = skeleton_named(skeleton)
        except ValueError as error:
            raise BodyModelError(str(error)) from error
        own = self.regressors.get(skeleton)
        chosen = skeleton_regressor(skeleton, self.surface_points) if own is None else own
        return to_dtype(chosen, self.dtype)

    def landmarks(self, output: BodyOutput, skeleton: Skeleton | str) -> Tensor:
        """Return the keypoints (B, J, 3) of a skeleton on posed bodies, metres.

        Args:
            output: with all vertices.
            skeleton: or the name of a standard one.

        Raises:
            BodyModelError: as :meth:`regressor`, or vertices are missing in the output.
        """
        regressor = self.regressor(skeleton)
        if output.vertices.shape[1] != self.num_vertices:
            raise BodyModelError(
                f"landmarks need all {self.num_vertices} vertices, got {output.vertices.shape[1]}:"
                " pose the whole body, or use landmarks_only"
            )
        return regressor(output.joints, output.vertices.index_select(1, regressor.vertex_ids))

    def landmarks_only(
        self, skeletons: Sequence[Skeleton | str], vertex_ids: Tensor | None = None
    ) -> LandmarkModel:
        """Return a model that poses only the keypoints of some skeletons, for iterative fits.

        Args:
            skeletons: or names of standard ones.
            vertex_ids: (n,) int64, further vertices to pose.

        Raises:
            BodyModelError: as :meth:`regressor`.
        """
        extra = torch.zeros(0, dtype=torch.int64) if vertex_ids is None else vertex_ids
        regressors = {skeleton: self.regressor(skeleton) for skeleton in skeletons}
        wanted = torch.cat([extra, *(r.vertex_ids for r in regressors.values())])
        sizes = [len(extra), *(len(r.vertex_ids) for r in regressors.values())]
        return LandmarkModel(
            self,
            self.skin.subset(wanted).in_blocks(),
            regressors,
            tuple(sizes),
            JointTree(self.kinematics),
        )

    def stature(self, betas: Tensor) -> Tensor:
        """Return the height (B,) in metres of betas (B, K) in the T-pose, from soles to crown."""
        rotations, _, transl = self.zero_pose(len(betas))
        output = self(rotations, betas, transl, vertex_ids=self.extremes)
        height = output.vertices[..., 1]
        return height.amax(1) - height.amin(1)

    def _check(
        self, rotations: Tensor, betas: Tensor, transl: Tensor, expression: Tensor | None
    ) -> None:
        """Raise BodyModelError if a parameter has the wrong shape."""
        batch = len(rotations)
        wanted = [
            ("rotations", rotations, (batch, NUM_JOINTS, 3, 3)),
            ("betas", betas, (batch, self.num_betas)),
            ("transl", transl, (batch, 3)),
        ]
        if expression is not None:
            wanted.append(("expression", expression, (batch, self.num_expression)))
        for name, value, shape in wanted:
            if tuple(value.shape) != shape:
                raise BodyModelError(
                    f"{name} must be {shape} for the {self.name} body, got {tuple(value.shape)}:"
                    " give one row per person, and parameters of this body model"
                )


@dataclass(frozen=True, eq=False)
class LandmarkModel:
    """Body model that poses only joints, keypoints and a few vertices.

    Attributes:
        body: the complete model.
        skin: the posed vertices: first ``vertex_ids``, then those of each skeleton.
        regressors: skeleton -> its points from joints and its vertices.
        sizes: numbers of vertices of these groups.
        tree: matrices of the joint tree.
    """

    body: BodyModel
    skin: Skin
    regressors: Mapping[Skeleton | str, LandmarkRegressor]
    sizes: tuple[int, ...]
    tree: JointTree

    def __call__(
        self, rotations: Tensor, betas: Tensor, transl: Tensor, expression: Tensor | None = None
    ) -> dict[Skeleton | str, Tensor]:
        """Pose B bodies, with arguments as in :meth:`BodyModel.__call__`; differentiable once.

        Returns:
            Skeleton, as it was given -> (B, J, 3) metres; also "joints" (B, 55, 3), and "vertices"
            (B, n, 3) of ``vertex_ids``.
        """
        self.body._check(rotations, betas, transl, expression)
        shape = _coefficients(self.body.num_expression, betas, expression)
        posed, joints = pose_vertices(self.tree, self.skin, rotations, shape, transl)
        return self.named(joints, posed)

    def named(self, joints: Tensor, vertices: Tensor) -> dict[Skeleton | str, Tensor]:
        """Return the landmarks (..., J, 3) of posed joints (..., 55, 3) and vertices (..., n, 3) of
        the skin. Linear, so derivatives may be passed too.
        """
        own, *groups = torch.split(vertices, list(self.sizes), dim=-2)
        points = {
            name: regressor(joints, group)
            for (name, regressor), group in zip(self.regressors.items(), groups, strict=True)
        }
        return {**points, "joints": joints, "vertices": own}


def _coefficients(num_expression: int, betas: Tensor, expression: Tensor | None) -> Tensor:
    """Concatenate betas and expression to (B, K + E)."""
    if not num_expression:
        return betas
    return torch.cat(
        [betas, betas.new_zeros(len(betas), num_expression) if expression is None else expression],
        1,
    )


def build_body_model(arrays: BodyArrays) -> BodyModel:
    """Build a BodyModel, float32."""
    picks = derive_vertex_sets(arrays) if arrays.picks is None else arrays.picks
    kinematics, skin = _mechanics(arrays)
    return BodyModel(
        name=arrays.name,
        topology=arrays.topology,
        faces=torch.as_tensor(arrays.faces),
        num_betas=arrays.num_betas,
        num_expression=arrays.num_expression,
        part_names=PART_NAMES,
        part_of_vertex=torch.as_tensor(arrays.part_of_vertex),
        contact_sets=_ids(picks.contact_sets),
        outer=torch.as_tensor(arrays.outer),
        surface_points=_ids(picks.surface_points),
        kinematics=kinematics,
        skin=skin,
        extremes=torch.as_tensor(picks.extremes.astype(np.int64)),
        info=arrays.info,
    )


_NUM_CROWN = 40

_NUM_GROUND = 400
"""Number of candidate vertices for the highest and for the lowest point of any shape."""


def derive_vertex_sets(arrays: BodyArrays) -> VertexSets:
    """Derive body parts, contact sets and landmarks of the mean body from its geometry and skinning
    weights.
    """
    kinematics, skin = _mechanics(arrays)
    none = torch.zeros(1, 0)
    world, skinning = kinematics.transforms(
        torch.eye(3).repeat(1, 55, 1, 1), kinematics.rest_joints(none)
    )
    mesh = TPoseMesh(
        vertices=skin.pose(none, skinning)[0].double().numpy(),
        faces=arrays.faces,
        joints=world[0, :, :, 3].double().numpy(),
        weights=arrays.weights.astype(np.float64),
        outer=arrays.outer,
    )
    by_height = np.argsort(mesh.vertices[:, 1], kind="stable")
    extremes = np.unique(np.concatenate([by_height[:_NUM_GROUND], by_height[-_NUM_CROWN:]]))
    return VertexSets(
        mesh.part_of_vertex, contact_set_vertices(mesh), pick_surface_points(mesh), extremes
    )


def _mechanics(arrays: BodyArrays) -> tuple[Kinematics, Skin]:
    """Build the Kinematics and the Skin of an asset."""
    bind_rot = None if arrays.bind_rot is None else _float(arrays.bind_rot)
    kinematics = Kinematics.build(
        _float(arrays.joint_template), _float(arrays.joint_directions), bind_rot, PARENTS
    )
    skin = Skin(
        _float(arrays.template).T.contiguous(),
        _float(arrays.directions).transpose(1, 2).contiguous(),
        _float(arrays.weights).T.contiguous(),
    )
    return kinematics, skin


def _float(array: AnyArray) -> Tensor:
    """Convert an array to a float32 tensor."""
    return torch.as_tensor(np.asarray(array, dtype=np.float32))


def _ids(groups: Mapping[str, AnyArray]) -> dict[str, Tensor]:
    """Convert id arrays to int64 tensors."""
    return {name: torch.as_tensor(ids.astype(np.int64)) for name, ids in groups.items()}


def rest_mesh_of_model(model: BodyModel) -> RestMesh:
    """Return the mesh of the mean body of a model in its T-pose."""
    with torch.no_grad():
        vertices = model(*model.zero_pose()).vertices[0].numpy()
    return RestMesh(model.topology, vertices, model.faces.numpy())
