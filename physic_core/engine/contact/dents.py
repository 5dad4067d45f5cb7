"""Dents of surfaces that yield under people, by surface class. Camera frame, metres.

The scene is reconstructed without people. A body below the surface of a bed has pressed it down, as
far as beds yield; only what is deeper is an error. The depths of :data:`GIVE_M` are set by hand.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from physic_core.engine.contact.distance import SurfaceDistances
from physic_core.engine.contact.scene_parts import SceneParts

GIVE_M: Mapping[str, float] = {
    "bed": 0.10,
    "seat": 0.08,
    "vegetation": 0.05,
    "ground": 0.03,
    "rug": 0.02,
}
"""Class of :data:`physic_core.types.SURFACE_NAMES` -> largest depth of a dent, metres.

"ground" may be sand or grass. Surfaces of all other classes, and those of unknown class, do not
yield.
"""


def largest_dents(near: SurfaceDistances, parts: SceneParts) -> Tensor:
    """Return the largest depth (N, V) of a dent of the surface nearest to each vertex; 0 where none
    is near.
    """
    if not len(parts.label):
        return torch.zeros_like(near.scene)
    table = near.scene.new_tensor([0.0, *(GIVE_M.get(name, 0.0) for name in parts.names)])
    return torch.where(torch.isfinite(near.scene), table[parts.label + 1][near.point], 0.0)


def dent_depths(distance: Tensor, give: Tensor) -> Tensor:
    """Return how deep vertices press into yielding surfaces, metres: (N, V), NaN elsewhere.

    Args:
        distance: (N, V) signed, to the undented scene, metres.
        give: (N, V) largest depth.
    """
    depth = torch.minimum(torch.relu(-torch.nan_to_num(distance, posinf=0.0)), give)
    return torch.where(give > 0, depth, torch.nan)
