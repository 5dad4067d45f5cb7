"""Classes of the scene points that carry people, corrected by what can carry.

People hide what carries them: labels under and beside them are those of the wall behind them, or of an object that a
foot looks like. A surface under skin that faces down is level.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from scipy.spatial import cKDTree
from torch import Tensor

from physic_core.engine.contact.scene_parts import SceneParts

__all__ = ["correct_carrying_classes"]

_UPRIGHT_CLASSES = ("wall", "window", "ceiling")
_FLOOR_M = 0.05  # height over the floor, up to which a point that carries is floor
_NEIGHBOUR_M = 0.5  # within which another point gives its class


def correct_carrying_classes(parts: SceneParts, points: Tensor, carrying: Tensor, height: Tensor | None) -> SceneParts:
    """Return the scene parts with other classes of points that carry people.

    A point within 5 cm of the floor is floor. A point of a wall, window or ceiling has the class and surface of the
    nearest point of another class within half a metre. Without one its class is unknown, on a surface of its own.

    Args:
        parts: of n scene points.
        points: (n, 3) metres.
        carrying: (n,) bool, points under skin that faces down.
        height: (n,) of the points over the floor, metres, or None.
    """
    ground, label, surface = parts.ground, parts.label.clone(), parts.surface.clone()
    if height is not None:
        ground = ground | (carrying & (height.abs() < _FLOOR_M))
    upright = torch.tensor([name in _UPRIGHT_CLASSES for name in parts.names], device=label.device)
    wrong = carrying & ~ground & (label >= 0) & upright[label]
    if bool(wrong.any()):
        source = ((label >= 0) & ~upright[label] & ~ground).nonzero(as_tuple=True)[0]
        label[wrong], surface[wrong] = -1, int(surface.max()) + 1
        if len(source):
            tree = cKDTree(points[source].cpu().numpy())
            distance, index = tree.query(points[wrong].cpu().numpy(), distance_upper_bound=_NEIGHBOUR_M)
            near = torch.isfinite(torch.from_numpy(distance)).to(wrong.device)
            rows = wrong.nonzero(as_tuple=True)[0][near]
            nearest = source[torch.from_numpy(index).to(wrong.device)[near]]
            label[rows], surface[rows] = label[nearest], surface[nearest]
    return replace(parts, ground=ground, label=label, surface=surface)
