"""Convert between BodyParameters (rotation vectors) and rotation matrices."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from physic_core.body.joints import NUM_JOINTS, ROTATION_FIELDS
from physic_core.body.rotations import rotmat_to_rotvec
from physic_core.errors import BodyModelError
from physic_core.geometry.rotations import rotvec_to_rotmat
from physic_core.types import BodyParameters


def rotations_from_parameters(
    parameters: BodyParameters, device: torch.device | str = "cpu", dtype: torch.dtype = torch.float32
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
        own = torch.from_numpy(np.require(value, requirements=["C", "W"]))
        columns.append(own.to(device=device, dtype=dtype).view(rows, count, 3))
    return rotvec_to_rotmat(torch.cat(columns, 1))


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
            f"rotations must be (N, {NUM_JOINTS}, 3, 3), got {tuple(rotations.shape)}: give one matrix for each joint"
        )
    rotvecs = torch.from_numpy(rotmat_to_rotvec(rotations.detach().double().cpu().numpy()))
    pieces = rotvecs.split([count for _, count in ROTATION_FIELDS], dim=1)  # type: ignore[no-untyped-call]
    poses = {
        name: piece.flatten(1).float().cpu().numpy() for (name, _), piece in zip(ROTATION_FIELDS, pieces, strict=True)
    }
    given = transl.new_zeros(rows, 0) if expression is None else expression
    rest = {"betas": betas, "expression": given, "transl": transl}
    return BodyParameters(**poses, **{name: value.detach().float().cpu().numpy() for name, value in rest.items()})
