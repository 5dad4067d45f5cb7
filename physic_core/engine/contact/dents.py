"""Dents of surfaces that give way under people, by the class of the surface. Camera frame, metres.

The scene is reconstructed as it is without people. A body that lies below the surface of a bed has pressed it down, as
far as beds allow; only what is deeper is an error. The depths of :data:`GIVE_M` are set by hand.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from physic_core.engine.contact.scene_parts import SceneParts

__all__ = ["GIVE_M", "above_dents", "dent_depths", "give_of_points"]

GIVE_M: Mapping[str, float] = {"bed": 0.10, "seat": 0.08, "vegetation": 0.05, "ground": 0.03, "rug": 0.02}
"""Class of :data:`physic_core.types.SURFACE_NAMES` -> largest depth of a dent, metres. "ground" may be sand or grass.
Surfaces of all other classes, and those of unknown class, do not give way."""


def give_of_points(parts: SceneParts) -> Tensor:
    """Return the largest depth (n,) of a dent at each scene point, metres."""
    table = parts.label.new_tensor([0.0, *(GIVE_M.get(name, 0.0) for name in parts.names)], dtype=torch.float64)
    return table[parts.label + 1]


def above_dents(distance: Tensor, give: Tensor) -> Tensor:
    """Return signed distances (...) to the dented surface: 0 within a dent of at most ``give`` (...), metres."""
    return distance + torch.minimum(torch.relu(-distance), give.to(distance))


def dent_depths(distance: Tensor, give: Tensor) -> Tensor:
    """Return how deep vertices press into a surface (...): their depth below it, and at most ``give``, metres.

    Args:
        distance: (...) signed, to the undented surface; inf where it is far.
        give: (...) largest depth.
    """
    return torch.minimum(torch.relu(-torch.nan_to_num(distance, posinf=0.0)), give.to(distance))
