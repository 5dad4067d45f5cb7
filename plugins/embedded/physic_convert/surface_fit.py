"""Fit a body model to surface points with known correspondence."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_convert.joint_fit import BodyFit
from physic_core.body import (
    ANCESTOR_MATRIX,
    NUM_JOINTS,
    PARENTS,
    BoneOffsets,
    cholesky_solve,
    fit_shape,
    matmul,
    rotations_from_parents,
)
from physic_core.geometry import cross, exact_arrays, nearest_rotation, rotvec_to_rotmat_numpy

if TYPE_CHECKING:
    from physic_core.body import BodyModel
    from physic_core.types import BoolArray, Float32Array, Float64Array, Int64Array


_UP = np.array(PARENTS[1:])

_ROUNDS = 2
SURFACE_SIGMA_M = 0.01
"""Standard deviation of a vertex from another mesh, metres: residuals are correlated over the
surface.
"""
_VERTICES_PER_BONE = 20
"""Number of fitted vertices of each bone."""
_MIN_WEIGHT = 0.1
"""Minimum share of the weights of a bone that its points have; with less, the bone follows its
parent.
"""
_TANGENT_WEIGHT = 0.05
"""Weight of the residual along the surface, which points determine poorly."""
_DAMPING_M2 = 1e-4
"""Regularisation of small rotations, in square metres of lever arms."""


@dataclass(frozen=True)
class SampledBodyModel:
    """Blend shapes and skinning weights of some vertices of a model, NumPy float64.

    Attributes:
        bones: of the model.
        ids: (n,) which vertices.
        template: (n, 3) metres, bind pose.
        directions: (K, n, 3) change with one unit of each shape component.
        correctives: (P, n, 3) change with each number of the local rotations, or None.
        weights: (n, 55) of skinning.
        joints: (55, 3) metres, bind pose.
        joint_directions: (K, 55, 3).
        bound: (55, 3, 3) rotation of each bone from the bind pose to the T-pose.
    """

    bones: BoneOffsets
    ids: Int64Array
    template: Float64Array
    directions: Float64Array
    correctives: Float32Array | None
    weights: Float64Array
    joints: Float64Array
    joint_directions: Float64Array
    bound: Float64Array

    @classmethod
    def of(cls, model: BodyModel, ids: Int64Array) -> SampledBodyModel:
        """Extract the data of the vertices ``ids`` (n,) of a model."""
        count = model.num_betas
        kinematics = model.kinematics
        skin = model.skin.subset(torch.as_tensor(ids))
        directions = skin.directions.permute(0, 2, 1)
        poses = directions[count + model.num_expression :].numpy()
        eye = torch.eye(3).repeat(NUM_JOINTS, 1, 1)
        template, shapes, weights, joints, joint_shapes, bound = exact_arrays(
            skin.template.T,
            directions[:count],
            skin.weights.T,
            kinematics.template,
            kinematics.directions[:count].view(count, NUM_JOINTS, 3),
            eye if kinematics.bind_rot is None else kinematics.bind_rot,
        )
        return cls(
            bones=BoneOffsets.of(model),
            ids=ids,
            template=template,
            directions=shapes,
            correctives=poses if len(poses) else None,
            weights=weights,
            joints=joints,
            joint_directions=joint_shapes,
            bound=bound,
        )

    @cached_property
    def rotation_weights(self) -> Float64Array:
        """(55, n) weight of each vertex in the fit of each bone's rotation."""
        squared: Float64Array = (self.weights * self.weights).T
        weights: Float64Array = squared / np.maximum(squared.sum(1, keepdims=True), 1e-12)
        return weights

    def linear(self, world: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return the posed vertices as a linear function of the betas.

        Args:
            world: (B, 55, 3, 3).

        Returns:
            start: (B, n, 3) vertices of the mean shape, with no translation.
            slopes: (B, n, 3, K).
        """
        batch = len(world)
        points = len(self.ids)
        shapes = len(self.directions)
        turns = world @ self.bound
        by_vertex = matmul(self.weights, turns.reshape(batch, NUM_JOINTS, 9)).reshape(
            batch, points, 3, 3
        )
        none = np.zeros((batch, shapes))
        joint_positions = self.bones.pose(world, none, np.zeros((batch, 3)))
        shifts = joint_positions - (turns @ self.joints[..., None])[..., 0]
        template = self.template
        if self.correctives is not None:
            bent = (
                (rotations_from_parents(world)[:, 1:] - np.eye(3))
                .reshape(batch, -1)
                .astype(np.float32)
            )
            pose_offsets = matmul(bent, self.correctives.reshape(len(self.correctives), -1))
            template = template + pose_offsets.reshape(batch, points, 3)
        start = (by_vertex @ template[..., None])[..., 0] + matmul(self.weights, shifts)
        joint_slopes = self.bones.shape_jacobian(world) - turns @ self.joint_directions.transpose(
            1, 2, 0
        )
        carried = matmul(self.weights, joint_slopes.reshape(batch, NUM_JOINTS, -1))
        slopes = carried.reshape(batch, points, 3, shapes)
        # Three steps along contiguous rows: ten times as fast as a product of small matrices for
        # each vertex.
        for axis, rows in enumerate(self.directions.transpose(2, 1, 0)):
            slopes += by_vertex[..., axis, None] * rows[:, None]
        return start, slopes

    def posed(self, fit: BodyFit) -> Float64Array:
        """Return the vertices (B, n, 3), metres, of fitted bodies."""
        start, slopes = self.linear(fit.world)
        return start + (slopes @ fit.betas[:, None, :, None])[..., 0] + fit.transl[:, None]

    def lever_arms(self, world: Float64Array, betas: Float64Array) -> Float64Array:
        """Return lever arms (B, n, 55, 3): a small rotation w of a bone moves a vertex by ``w x
        lever``.

        The descendants of the bone move with it.
        """
        batch = len(world)
        points = len(self.ids)
        turns = world @ self.bound
        template = self.template + (betas @ self.directions.reshape(len(betas[0]), -1)).reshape(
            batch, points, 3
        )
        joints = self.joints + (betas @ self.joint_directions.reshape(len(betas[0]), -1)).reshape(
            batch, NUM_JOINTS, 3
        )
        own = matmul(template, turns.transpose(0, 3, 1, 2).reshape(batch, 3, 3 * NUM_JOINTS))
        own -= (turns @ joints[..., None]).reshape(batch, 1, 3 * NUM_JOINTS)
        levers = self.weights[..., None] * own.reshape(batch, points, NUM_JOINTS, 3)
        # Bones beyond a joint, from it to the next one.
        next_ = np.arange(1, NUM_JOINTS)
        offsets = self.bones.for_betas(betas)[:, 1:]
        bones = np.zeros((batch, NUM_JOINTS, NUM_JOINTS, 3))
        bones[:, next_, _UP] = (world[:, _UP] @ offsets[..., None])[..., 0]
        levers += matmul(self.descendant_weights, bones.reshape(batch, NUM_JOINTS, -1)).reshape(
            levers.shape
        )
        return levers

    @cached_property
    def descendant_weights(self) -> Float64Array:
        """(n, 55) sum of the skinning weights of each bone and its descendants, at each vertex."""
        return matmul(self.weights, ANCESTOR_MATRIX)


def sample_vertices(model: BodyModel, per_bone: int = _VERTICES_PER_BONE) -> Int64Array:
    """Return the ids of at most ``per_bone`` outer vertices of each bone, evenly sampled by id,
    ascending.
    """
    owner = model.skin.weights.argmax(0).numpy()
    outer = model.outer.numpy()
    chosen = []
    for joint in range(NUM_JOINTS):
        own = np.flatnonzero((owner == joint) & outer)
        chosen.append(own[:: max(1, -(-len(own) // per_bone))])
    return np.sort(np.concatenate(chosen))


@dataclass(frozen=True)
class SurfaceTargets:
    """Points of a surface for n vertices of B bodies.

    Attributes:
        points: (B, n, 3) metres, one for each vertex.
        weights: (B, n) in [0, 1]; 0 for a vertex without a point.
        normals: (B, n, 3) unit, of the surface that the points are on, where a vertex may as well
            lie beside its point: of the way along the surface only a share of _TANGENT_WEIGHT
            counts.
    """

    points: Float64Array
    weights: Float64Array
    normals: Float64Array | None = None


def fit_surface(
    patches: SampledBodyModel,
    targets: SurfaceTargets,
    rounds: int = _ROUNDS,
    start: BodyFit | None = None,
    *,
    sigma_m: float = SURFACE_SIGMA_M,
    stay_m2: float = _DAMPING_M2,
) -> BodyFit:
    """Fit a body model to surface points with known correspondence.

    Each bone is aligned with its points by Kabsch. Then Gauss-Newton rounds correct rotations,
    shape and translation together.

    Args:
        patches: the vertices.
        targets: their points.
        rounds: number of Gauss-Newton rounds.
        start: initial bodies; None to align every bone from the T-pose.
        sigma_m: standard deviation of a vertex from its point, metres; it sets the weight of the
            shape prior.
        stay_m2: square metres of levers below which a bone does not turn.
    """
    points = targets.points
    weights = targets.weights
    held = (patches.rotation_weights[None] * weights[:, None]).sum(-1) > _MIN_WEIGHT
    if start is None:
        world = _follow_parents(_kabsch_rotations(patches, points, weights), held)
        at_rest, slopes = patches.linear(world)
        start = BodyFit(world, *fit_shape(slopes, at_rest, points, weights / sigma_m**2))
    fit = start
    shapes = fit.betas.shape[1]
    stay = np.concatenate(
        [np.full(3 * NUM_JOINTS, stay_m2 / sigma_m**2), np.ones(shapes), np.zeros(3)]
    )
    for _ in range(rounds):
        normal, pull = _step_equations(patches, targets, fit, sigma_m)
        pull[:, -shapes - 3 : -3] -= fit.betas
        step = cholesky_solve(normal + np.diag(stay), pull)
        turns = rotvec_to_rotmat_numpy(step[:, : 3 * NUM_JOINTS].reshape(-1, NUM_JOINTS, 3))
        fit = BodyFit(
            _follow_parents(turns @ fit.world, held),
            fit.betas + step[:, -shapes - 3 : -3],
            fit.transl + step[:, -3:],
        )
    return fit


def _step_equations(
    patches: SampledBodyModel, targets: SurfaceTargets, fit: BodyFit, sigma_m: float
) -> tuple[Float64Array, Float64Array]:
    """Return the normal equations of a step of rotations, shape and translation."""
    points = targets.points
    root = np.sqrt(targets.weights)[..., None] / sigma_m
    at_rest, slopes = patches.linear(fit.world)
    shape_offsets = (slopes @ fit.betas[:, None, :, None])[..., 0]
    gap = root * (points - at_rest - shape_offsets - fit.transl[:, None])
    levers = root[..., None] * patches.lever_arms(fit.world, fit.betas)
    translation_slopes = np.broadcast_to(np.eye(3), (*points.shape, 3))
    linear = root[..., None] * np.concatenate([slopes, translation_slopes], -1)
    # A turn moves a vertex by w x lever, along an axis e by w . (lever x e).
    turns = cross(levers[:, :, None], np.eye(3)[:, None]).reshape(*points.shape, -1)
    design = np.concatenate([turns, linear], -1)
    parameters = design.shape[-1]
    normal, pull = _normal_equations(
        design.reshape(len(points), -1, parameters), gap.reshape(len(points), -1)
    )
    if targets.normals is None:
        return normal, pull
    normals = targets.normals
    across, along = _normal_equations(
        (normals[:, :, None] @ design)[:, :, 0], (normals * gap).sum(-1)
    )
    return _TANGENT_WEIGHT * normal + across, _TANGENT_WEIGHT * pull + along


def _normal_equations(design: Float64Array, gap: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the normal equations (B, M, M) and (B, M) of residuals (B, n) with derivatives
    (B, n, M).
    """
    across = np.swapaxes(design, 1, 2)
    return matmul(across, design), matmul(across, gap[..., None])[..., 0]


def _kabsch_rotations(
    patches: SampledBodyModel, points: Float64Array, weights: Float64Array
) -> Float64Array:
    """Return rotations (B, 55, 3, 3) that align the T-pose vertices of each bone with their points,
    by Kabsch.
    """
    rest = np.broadcast_to(np.eye(3), (1, NUM_JOINTS, 3, 3))
    now = patches.linear(rest)[0]
    share = patches.rotation_weights * weights[:, None]
    total = np.maximum(share.sum(-1, keepdims=True), 1e-12)
    mean_now, mean_there = (matmul(share, p) / total for p in (now, points))
    # sum w (q - mean)(v - mean)^T
    moments = (
        np.stack([matmul(share * now[:, None, :, k], points) for k in range(3)], -1)
        / total[..., None]
    )
    moments -= mean_there[..., :, None] * mean_now[..., None, :]
    return nearest_rotation(moments)


def _follow_parents(world: Float64Array, held: BoolArray) -> Float64Array:
    """Return rotations (B, 55, 3, 3) in which bones without points, (B, 55), follow their
    parents.
    """
    turned = world.copy()
    for joint in range(1, NUM_JOINTS):
        loose = ~held[:, joint]
        turned[loose, joint] = turned[loose, PARENTS[joint]]
    return turned
