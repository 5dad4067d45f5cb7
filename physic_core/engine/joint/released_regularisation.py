"""Bodies as the released code's regulariser sees them: where they would be without root rotation and translation."""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.body.model import LandmarkModel

__all__ = ["without_root"]


def without_root(pose: LandmarkModel, rotations: Tensor, betas: Tensor, expression: Tensor) -> Tensor:
    """Tracked vertices (B, n, 3) of bodies whose root does not turn: their pelvis lies where the shape puts it.

    Args:
        pose: poses them.
        rotations: (B, 55, 3, 3).
        betas: (B, K).
        expression: (B, E).
    """
    root = torch.eye(3, dtype=rotations.dtype, device=rotations.device).expand(len(rotations), 1, 3, 3)
    posed = pose(torch.cat([root, rotations[:, 1:]], 1), betas, betas.new_zeros(len(betas), 3), expression)
    return posed["vertices"]
