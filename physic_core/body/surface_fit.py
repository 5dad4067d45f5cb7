"""Fits a body model to points of a surface of which it is known where on the model they lie."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from physic_core.body.bones import FAMILY, Bones, fit_shape, local_from_world
from physic_core.body.joints import NUM_JOINTS, PARENTS
from physic_core.body.linalg import cholesky_solve, matmul
from physic_core.body.part_fit import Fit
from physic_core.body.rotations import cross, exp, nearest_rotation

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel

__all__ = ["SIGMA_M", "Patches", "fit_surface", "spread"]

Array = NDArray[np.float64]

_UP = np.array(PARENTS[1:])

_ROUNDS = 2
SIGMA_M = 0.03
"""How far a vertex may lie from that of another mesh, metres: what is left over is alike for all round it."""
_A_BONE = 20
"""Vertices of each bone that are fitted."""
_HELD = 0.1
"""Of all that the vertices could say of a bone: below it, the bone is held by none."""
_BESIDE = 0.05
"""How much the way along the surface counts, where points say little of it."""
_STAY_M2 = 1e-4
"""Of levers: so that a part that too few points hold stays as it is."""


@dataclass(frozen=True)
class Patches:
    """Some vertices of a model, float64, coordinates last.

    Attributes:
        bones: of the model.
        ids: (n,) which vertices.
        template: (n, 3) metres, in the pose that they are bound in.
        directions: (K, n, 3) change with one unit of each shape component.
        correctives: (P, n, 3) change with each number of the local rotations, or None.
        weights: (n, 55) of skinning.
        joints: (55, 3) where the bones are bound.
        joint_directions: (K, 55, 3).
        bound: (55, 3, 3) rotation of each bone from the pose that it is bound in to the T-pose.
    """

    bones: Bones
    ids: NDArray[np.int64]
    template: Array
    directions: Array
    correctives: NDArray[np.float32] | None
    weights: Array
    joints: Array
    joint_directions: Array
    bound: Array

    @classmethod
    def of(cls, model: BodyModel, ids: NDArray[np.int64]) -> Patches:
        """Of the vertices ``ids`` (n,) of a model."""
        count, kinematics = model.num_betas, model.kinematics
        skin = model.skin.subset(torch.as_tensor(ids, device=model.device))
        directions = skin.directions.cpu().permute(0, 2, 1)
        poses = directions[count + model.num_expression :].numpy()
        eye = torch.eye(3).repeat(NUM_JOINTS, 1, 1)
        return cls(
            Bones.of(model),
            ids,
            skin.template.T.double().cpu().numpy(),
            directions[:count].double().numpy(),
            poses if len(poses) else None,
            skin.weights.T.double().cpu().numpy(),
            kinematics.template.double().cpu().numpy(),
            kinematics.directions[:count].double().cpu().numpy().reshape(count, NUM_JOINTS, 3),
            (eye if kinematics.bind_rot is None else kinematics.bind_rot).double().cpu().numpy(),
        )

    @cached_property
    def shares(self) -> Array:
        """(55, n): how much each vertex says of the rotation of each bone."""
        squared: Array = (self.weights * self.weights).T
        shares: Array = squared / np.maximum(squared.sum(1, keepdims=True), 1e-12)
        return shares

    def linear(self, world: Array) -> tuple[Array, Array]:
        """Bodies in one pose are linear in their shape.

        Args:
            world: (B, 55, 3, 3).

        Returns:
            start: (B, n, 3) vertices of the mean shape, with no translation.
            slopes: (B, n, 3, K).
        """
        batch, points, shapes = len(world), len(self.ids), len(self.directions)
        turns = world @ self.bound
        by_vertex = matmul(self.weights, turns.reshape(batch, NUM_JOINTS, 9)).reshape(batch, points, 3, 3)
        none = np.zeros((batch, shapes))
        places = self.bones.pose(world, none, np.zeros((batch, 3)))
        shifts = places - (turns @ self.joints[..., None])[..., 0]
        template = self.template
        if self.correctives is not None:
            bent = (local_from_world(world)[:, 1:] - np.eye(3)).reshape(batch, -1).astype(np.float32)
            moved = matmul(bent, self.correctives.reshape(len(self.correctives), -1))
            template = template + moved.reshape(batch, points, 3)
        start = (by_vertex @ template[..., None])[..., 0] + matmul(self.weights, shifts)
        joint_slopes = self.bones.by_shape(world) - turns @ self.joint_directions.transpose(1, 2, 0)
        carried = matmul(self.weights, joint_slopes.reshape(batch, NUM_JOINTS, -1))
        slopes = carried.reshape(batch, points, 3, shapes)
        # Three steps along contiguous rows: ten times as fast as a product of small matrices for each vertex.
        for axis, rows in enumerate(self.directions.transpose(2, 1, 0)):
            slopes += by_vertex[..., axis, None] * rows[:, None]
        return start, slopes

    def levers(self, world: Array, betas: Array) -> Array:
        """(B, n, 55, 3): a small turn w of a bone, with all that hangs on it, moves a vertex by ``w x lever``."""
        batch, points = len(world), len(self.ids)
        turns = world @ self.bound
        template = self.template + (betas @ self.directions.reshape(len(betas[0]), -1)).reshape(batch, points, 3)
        joints = self.joints + (betas @ self.joint_directions.reshape(len(betas[0]), -1)).reshape(batch, NUM_JOINTS, 3)
        own = matmul(template, turns.transpose(0, 3, 1, 2).reshape(batch, 3, 3 * NUM_JOINTS))
        own -= (turns @ joints[..., None]).reshape(batch, 1, 3 * NUM_JOINTS)
        levers = self.weights[..., None] * own.reshape(batch, points, NUM_JOINTS, 3)
        # Of what hangs on a bone: the bones from its joint to the next.
        next_ = np.arange(1, NUM_JOINTS)
        offsets = self.bones.at(betas)[:, 1:]
        bones = np.zeros((batch, NUM_JOINTS, NUM_JOINTS, 3))
        bones[:, next_, _UP] = (world[:, _UP] @ offsets[..., None])[..., 0]
        levers += matmul(self.carried, bones.reshape(batch, NUM_JOINTS, -1)).reshape(levers.shape)
        return levers

    @cached_property
    def carried(self) -> Array:
        """(n, 55): how much of each vertex moves with a bone or with what hangs on it."""
        return matmul(self.weights, FAMILY)


def spread(model: BodyModel, a_bone: int = _A_BONE) -> NDArray[np.int64]:
    """Ids, ascending, of up to ``a_bone`` outer vertices of each bone, evenly through its list."""
    owner = model.skin.weights.argmax(0).cpu().numpy()
    outer = model.outer.cpu().numpy()
    chosen = []
    for joint in range(NUM_JOINTS):
        own = np.flatnonzero((owner == joint) & outer)
        chosen.append(own[:: max(1, -(-len(own) // a_bone))])
    return np.sort(np.concatenate(chosen))


def fit_surface(
    patches: Patches,
    points: Array,
    weights: Array,
    rounds: int = _ROUNDS,
    start: Fit | None = None,
    *,
    sigma_m: float = SIGMA_M,
    stay_m2: float = _STAY_M2,
    normals: Array | None = None,
) -> Fit:
    """Bodies whose vertices lie where the points do.

    Every bone is turned onto its points by Kabsch; then rotations, shape and translation are corrected together, each
    round by the normal equations of all three, since all are linear in small turns.

    Args:
        patches: the vertices.
        points: (B, n, 3) metres, one for each.
        weights: (B, n) in [0, 1]; 0 where a vertex has no point.
        rounds: how often all is corrected.
        start: bodies to begin with; None to turn every bone from the T-pose.
        sigma_m: how far a vertex may lie from its point, metres; it sets how much the mean shape pulls.
        stay_m2: square metres of levers below which a bone does not turn.
        normals: (B, n, 3) unit, of the surface that the points are on, where a vertex may as well lie beside its point:
            of the way along the surface only a share of _BESIDE counts.
    """
    batch = len(points)
    held = (patches.shares[None] * weights[:, None]).sum(-1) > _HELD
    if start is None:
        world = _following(_turned(patches, points, weights), held)
        at_rest, slopes = patches.linear(world)
        start = Fit(world, *fit_shape(slopes, at_rest, points, weights / sigma_m**2))
    world, betas, transl = start.world, start.betas, start.transl
    root = np.sqrt(weights)[..., None] / sigma_m
    shapes = betas.shape[1]
    stay = np.concatenate([np.full(3 * NUM_JOINTS, stay_m2 / sigma_m**2), np.ones(shapes), np.zeros(3)])
    for _ in range(rounds):
        at_rest, slopes = patches.linear(world)
        gap = root * (points - at_rest - (slopes @ betas[:, None, :, None])[..., 0] - transl[:, None])
        levers = root[..., None] * patches.levers(world, betas)
        places = np.broadcast_to(np.eye(3), (*points.shape, 3))
        linear = root[..., None] * np.concatenate([slopes, places], -1)
        normal, pull = _normal_equations(levers, linear, gap)
        if normals is not None:
            across, along = _normal_equations_along(levers, linear, gap, normals)
            normal, pull = _BESIDE * normal + across, _BESIDE * pull + along
        pull[:, -shapes - 3 : -3] -= betas
        step = cholesky_solve(normal + np.diag(stay), pull)
        world = _following(exp(step[:, : 3 * NUM_JOINTS].reshape(batch, NUM_JOINTS, 3)) @ world, held)
        betas, transl = betas + step[:, -shapes - 3 : -3], transl + step[:, -3:]
    return Fit(world, betas, transl)


def _turned(patches: Patches, points: Array, weights: Array) -> Array:
    """Rotations (B, 55, 3, 3) that turn the vertices of each bone from the T-pose onto their points, by Kabsch."""
    rest = np.broadcast_to(np.eye(3), (1, NUM_JOINTS, 3, 3))
    now = patches.linear(rest)[0]
    share = patches.shares * weights[:, None]
    total = np.maximum(share.sum(-1, keepdims=True), 1e-12)
    mean_now, mean_there = (matmul(share, p) / total for p in (now, points))
    # sum w (q - mean)(v - mean)^T
    moments = np.stack([matmul(share * now[:, None, :, k], points) for k in range(3)], -1) / total[..., None]
    moments -= mean_there[..., :, None] * mean_now[..., None, :]
    return nearest_rotation(moments)


def _following(world: Array, held: NDArray[np.bool_]) -> Array:
    """Rotations (B, 55, 3, 3) where bones that nothing holds, (B, 55), turn with their parents."""
    turned = world.copy()
    for joint in range(1, NUM_JOINTS):
        loose = ~held[:, joint]
        turned[loose, joint] = turned[loose, PARENTS[joint]]
    return turned


def _normal_equations(levers: Array, slopes: Array, gap: Array) -> tuple[Array, Array]:
    """Of small turns w_j of all bones, in the common frame, and of what the vertices are linear in.

    A turn moves a vertex by ``w_j x lever``; with ``Q = sum lever_j lever_k^T``, two bones meet in ``tr(Q) 1 - Q^T``.

    Args:
        levers: (B, n, 55, 3).
        slopes: (B, n, 3, M).
        gap: (B, n, 3) what is missing.

    Returns:
        (B, 165 + M, 165 + M) and (B, 165 + M).
    """
    batch, points = gap.shape[:2]
    turns, others = 3 * NUM_JOINTS, slopes.shape[-1]
    flat = np.swapaxes(levers.reshape(batch, points, turns), 1, 2)
    linear = slopes.reshape(batch, points, 3 * others)
    # Rounding of this product slows the rounds down by nothing; the gap itself is in float64.
    short = flat.astype(np.float32)
    met = matmul(short, np.swapaxes(short, 1, 2)).astype(np.float64).reshape(batch, NUM_JOINTS, 3, NUM_JOINTS, 3)
    normal = np.empty((batch, turns + others, turns + others))
    trace = met[:, :, 0, :, 0] + met[:, :, 1, :, 1] + met[:, :, 2, :, 2]
    corner = trace[:, :, None, :, None] * np.eye(3)[:, None, :] - met.transpose(0, 1, 4, 3, 2)
    normal[:, :turns, :turns] = corner.reshape(batch, turns, turns)
    both = matmul(flat, linear).reshape(batch, NUM_JOINTS, 3, 3, others)
    normal[:, :turns, turns:] = _curl(both.transpose(0, 1, 4, 2, 3)).transpose(0, 1, 3, 2).reshape(batch, turns, others)
    normal[:, turns:, :turns] = np.swapaxes(normal[:, :turns, turns:], 1, 2)
    design = slopes.reshape(batch, 3 * points, others)
    across = np.swapaxes(design, 1, 2)
    normal[:, turns:, turns:] = matmul(across, design)
    pull = np.concatenate(
        [
            _curl(matmul(flat, gap).reshape(batch, NUM_JOINTS, 3, 3)).reshape(batch, turns),
            matmul(across, gap.reshape(batch, 3 * points, 1))[..., 0],
        ],
        1,
    )
    return normal, pull


def _normal_equations_along(levers: Array, slopes: Array, gap: Array, normals: Array) -> tuple[Array, Array]:
    """The same where only the way along ``normals`` (B, n, 3) counts: ``n . (w x lever) = w . (lever x n)``."""
    turns = cross(levers, normals[:, :, None])
    design = np.concatenate([turns.reshape(*gap.shape[:2], -1), (normals[:, :, None] @ slopes)[:, :, 0]], -1)
    across = np.swapaxes(design, 1, 2)
    return matmul(across, design), matmul(across, (normals * gap).sum(-1, keepdims=True))[..., 0]


def _curl(products: Array) -> Array:
    """``sum a x b`` (..., 3) from ``sum a b^T`` (..., 3, 3)."""
    p = products
    return np.stack([p[..., 1, 2] - p[..., 2, 1], p[..., 2, 0] - p[..., 0, 2], p[..., 0, 1] - p[..., 1, 0]], -1)
