"""Rotations of bones from parameters and back, and joints of a body model in NumPy, float64.

For given rotations, the joints are linear in the betas. Matrix products and Cholesky solutions run
in torch, to use its number of threads: NumPy's BLAS uses one thread per core. For matrices of the
size of a body, such threads only wait for each other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX, NUM_JOINTS, PARENTS, ROTATION_FIELDS
from physic_core.errors import BodyModelError
from physic_core.geometry.rotations import rotmat_to_rotvec
from physic_core.geometry.rotvecs import rotvec_to_rotmat
from physic_core.geometry.tensors import arrays, exact_arrays, tensor
from physic_core.types import BodyParameters

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import Bodies, Float64Array

_HEAD = JOINT_INDEX["head"]
_UP = np.array([0, *PARENTS[1:]])


def rotations_from_parameters(
    parameters: BodyParameters,
    dtype: torch.dtype = torch.float32,
) -> Tensor:
    """Return rotation matrices (N, 55, 3, 3) of every joint relative to its parent.

    Raises:
        BodyModelError: a field does not have 3 numbers per joint.
    """
    rows = len(parameters)
    columns = []
    for name, count in ROTATION_FIELDS:
        value = getattr(parameters, name)
        if value.shape != (rows, 3 * count):
            raise BodyModelError(
                f"{name} must be ({rows}, {3 * count}), got {tuple(value.shape)}:"
                f" give a rotation vector in radians for each of its {count} joints"
            )
        # An array of a plugin may be a view with negative strides, or read-only.
        writable = torch.from_numpy(np.require(value, requirements=["C", "W"]))
        columns.append(writable.to(dtype).view(rows, count, 3))
    return rotvec_to_rotmat(torch.cat(columns, 1))


def head_direction(rotations: Tensor) -> Tensor:
    """Return the unit vectors (N, 3) in which heads look, camera frame, from the rotations
    (N, 55, 3, 3) of joints relative to their parents.
    """
    direction = rotations.new_tensor([0.0, 0.0, 1.0]).expand(len(rotations), 3)
    joint = _HEAD
    while joint >= 0:
        direction = (rotations[:, joint] @ direction[..., None])[..., 0]
        joint = PARENTS[joint]
    return direction


def pose_from_parameters(
    parameters: BodyParameters,
    dtype: torch.dtype = torch.float32,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return the arguments of a body model: rotations (N, 55, 3, 3), betas (N, K), transl (N, 3)
    and expression (N, E).
    """
    rest = (parameters.betas, parameters.transl, parameters.expression)
    betas, transl, expression = (tensor(value).to(dtype) for value in rest)
    return rotations_from_parameters(parameters, dtype), betas, transl, expression


def parameters_from_rotations(
    rotations: Tensor, betas: Tensor, expression: Tensor | None, transl: Tensor
) -> BodyParameters:
    """Convert rotation matrices, shape and translation to BodyParameters, float32 NumPy.

    Args:
        rotations: (N, 55, 3, 3).
        betas: (N, K).
        expression: (N, E), or None for E = 0.
        transl: (N, 3) metres.
    """
    rows = len(rotations)
    if tuple(rotations.shape) != (rows, NUM_JOINTS, 3, 3):
        raise BodyModelError(
            f"rotations must be (N, {NUM_JOINTS}, 3, 3), got {tuple(rotations.shape)}: give one "
            f"matrix for each joint"
        )
    rotvecs = torch.from_numpy(rotmat_to_rotvec(*exact_arrays(rotations)))
    pieces = rotvecs.split([count for _, count in ROTATION_FIELDS], dim=1)  # type: ignore[no-untyped-call]
    poses = {
        name: piece.flatten(1).float().numpy()
        for (name, _), piece in zip(ROTATION_FIELDS, pieces, strict=True)
    }
    values = transl.new_zeros(rows, 0) if expression is None else expression
    return BodyParameters(
        **poses,
        **arrays(betas=betas.detach(), expression=values.detach(), transl=transl.detach()),
    )


_Real = TypeVar("_Real", bound=np.floating[Any])


def matmul(a: NDArray[_Real], b: NDArray[_Real]) -> NDArray[_Real]:
    """Return ``a @ b`` for arrays of the same float type."""
    left, right = (torch.from_numpy(np.require(array, requirements="W")) for array in (a, b))
    return torch.matmul(left, right).numpy()


def cholesky_solve(normal: Float64Array, rhs: Float64Array) -> Float64Array:
    """Solve ``normal x = rhs`` by Cholesky: symmetric positive definite (B, M, M) and (B, M) -> x
    (B, M).
    """
    factor = torch.linalg.cholesky(torch.from_numpy(normal))
    return torch.cholesky_solve(torch.from_numpy(rhs)[..., None], factor)[..., 0].numpy()


def _ancestor_matrix() -> Float64Array:
    """Return the (55, 55) matrix that is 1 where the column is the joint of the row or one of its
    ancestors.
    """
    reach = np.eye(NUM_JOINTS)
    for joint in range(1, NUM_JOINTS):
        reach[joint] += reach[PARENTS[joint]]
    return reach


ANCESTOR_MATRIX = _ancestor_matrix()
"""(55, 55), 1 where the column is the joint of the row or one of its ancestors."""


@dataclass(frozen=True)
class BoneOffsets:
    """Offset of each joint from its parent in the T-pose; for the root, its position.

    Attributes:
        template: (55, 3) metres, mean shape.
        directions: (K, 55, 3) change with one unit of each shape component.
    """

    template: Float64Array
    directions: Float64Array

    @classmethod
    def of(cls, model: BodyModel) -> BoneOffsets:
        """Extract the bone offsets of a body model, with zero expression."""
        kinematics = model.kinematics
        count = model.num_betas
        rest, change = exact_arrays(
            kinematics.template[None], kinematics.directions[:count].view(count, NUM_JOINTS, 3)
        )
        both = np.concatenate([rest, change])
        both[:, 1:] -= both[:, _UP[1:]]
        if kinematics.bind_rot is not None:
            turn = exact_arrays(kinematics.bind_rot)[0][_UP[1:]]
            both[:, 1:] = (turn @ both[:, 1:, :, None])[..., 0]
        return cls(both[0], both[1:])

    def for_betas(self, betas: Float64Array) -> Float64Array:
        """Return the bone offsets (B, 55, 3), metres, for betas (B, K)."""
        flat = betas @ self.directions.reshape(len(self.directions), -1)
        return self.template + flat.reshape(-1, NUM_JOINTS, 3)

    def rest(self, betas: Float64Array) -> Float64Array:
        """Return the T-pose joints (B, 55, 3) for betas (B, K)."""
        return ANCESTOR_MATRIX @ self.for_betas(betas)

    def pose(self, world: Float64Array, betas: Float64Array, transl: Float64Array) -> Float64Array:
        """Return the posed joints (B, 55, 3), metres, for world rotations (B, 55, 3, 3) relative to
        the T-pose.
        """
        carried = self.for_betas(betas)
        carried[:, 1:] = (world[:, _UP[1:]] @ carried[:, 1:, :, None])[..., 0]
        return ANCESTOR_MATRIX @ carried + transl[:, None]

    def shape_jacobian(self, world: Float64Array) -> Float64Array:
        """Return the derivative (B, 55, 3, K) of the posed joints with respect to the betas."""
        batch = len(world)
        count = len(self.directions)
        turns = world[:, _UP].copy()
        turns[:, 0] = np.eye(3)
        carried = turns @ self.directions.transpose(1, 2, 0)
        return (ANCESTOR_MATRIX @ carried.reshape(batch, NUM_JOINTS, -1)).reshape(
            batch, NUM_JOINTS, 3, count
        )


def fit_shape(
    slopes: Float64Array,
    start: Float64Array,
    targets: Float64Array,
    weights: Float64Array,
    ridge: float = 1.0,
) -> tuple[Float64Array, Float64Array]:
    """Fit betas and translation to target points by ridge regression; the fitted points are linear
    in both.

    Minimises ``sum_i w_i |start_i + slopes_i betas + transl - target_i|^2 + ridge |betas|^2``.

    Args:
        slopes: (B, n, 3, K) of n points.
        start: (B, n, 3) points of the mean shape, metres.
        targets: (B, n, 3) metres; ignored where the weight is 0.
        weights: (B, n) one over squared metres.
        ridge: one over the variance of each shape component.

    Returns:
        betas (B, K) and transl (B, 3).
    """
    batch, count, _, shapes = slopes.shape
    total = np.maximum(weights.sum(1), 1e-12)[:, None]
    share = weights / total
    # Relative to their weighted means, the points do not depend on the translation.
    mean_slope = np.einsum("bn,bnik->bik", share, slopes, optimize=True)
    gap = np.where(weights[..., None] > 0, targets - start, 0.0)
    mean_gap = np.einsum("bn,bni->bi", share, gap)
    root = np.sqrt(weights)[..., None]
    design = (root[..., None] * (slopes - mean_slope[:, None])).reshape(batch, 3 * count, shapes)
    wanted = (root * (gap - mean_gap[:, None])).reshape(batch, 3 * count, 1)
    across = np.swapaxes(design, 1, 2)
    normal = matmul(across, design) + ridge * np.eye(shapes)
    betas = cholesky_solve(normal, matmul(across, wanted)[..., 0])
    return betas, mean_gap - (mean_slope @ betas[..., None])[..., 0]


def rotations_from_tpose(local: Float64Array) -> Float64Array:
    """Convert rotations (B, 55, 3, 3) relative to the parents to rotations relative to the
    T-pose.
    """
    world = local.copy()
    for joint in range(1, NUM_JOINTS):
        world[:, joint] = world[:, PARENTS[joint]] @ local[:, joint]
    return world


def rotations_from_parents(world: Float64Array) -> Float64Array:
    """Convert rotations (B, 55, 3, 3) relative to the T-pose to rotations relative to the
    parents.
    """
    local = np.swapaxes(world[:, _UP], -1, -2) @ world
    local[:, 0] = world[:, 0]
    return local


def replace_mesh_with_joints(bodies: Bodies, model: BodyModel) -> Bodies:
    """Return bodies with the posed joints of their body model, and without a mesh."""
    with torch.no_grad():
        joints = model(*pose_from_parameters(bodies.parameters), joints_only=True).joints
    return replace(bodies, joints=joints.numpy(), mesh=None)
