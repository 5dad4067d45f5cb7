"""Stage 4 of presets "paper", "release" and "prox": contact by distance to the nearest scene
point.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physic_core.engine.contact.distances import ContactSurfaces, Distances
from physic_core.engine.contact.method import ContactStageMethod, Touch
from physic_core.engine.scene_state import Surroundings
from physic_core.engine.state import State
from physic_core.types import NotNegative


@dataclass(frozen=True)
class DistanceContact(ContactStageMethod):
    """Stage 4 as published: contact by distance.

    ``threshold`` is not used.
    """

    distance_m: NotNegative = 0.02
    """Largest distance to scene or floor of a vertex in contact, metres; as released."""
    inside_m: NotNegative = 0.15
    """Largest depth inside of a vertex in contact, metres; as released."""
    people: bool = False
    assume_supports: bool = False

    def is_contact(self, distance: Tensor) -> Tensor:
        """Return which signed distances, metres, are those of vertices in contact."""
        return (distance <= self.distance_m) & (distance >= -self.inside_m)

    def surfaces(
        self, surroundings: Surroundings, vertices: Tensor, scale: float
    ) -> ContactSurfaces:
        """Return the scaled scene near bodies (N, V, 3), metres, with the samples of the floor."""
        surfaces = super().surfaces(with_floor_samples(surroundings), vertices, scale)
        return replace(
            surfaces, row=torch.where(surfaces.row < len(surroundings.points), surfaces.row, -1)
        )

    def free_vertices(self, state: State) -> None:
        """Return None: free space is not used."""

    def measure(self, offsets: Tensor, normals: Tensor, distance: Tensor) -> Tensor:
        """Return the distance to the nearest point."""
        return distance

    def find_touch(self, state: State, near: Distances) -> Touch:
        """Return the contacts of vertices whose distance is within the bounds of the settings."""
        distance = near.by_kind
        within = self.is_contact(distance) & state.model.outer
        nearest = torch.where(within, distance.abs(), torch.inf).argmin(0)
        return Touch(torch.where(within.any(0), nearest, -1), None)


def with_floor_samples(surroundings: Surroundings) -> Surroundings:
    """Return the surroundings with samples of the floor among the points, instead of its plane."""
    if surroundings.floor is None:
        return surroundings
    up = surroundings.floor.normal.expand_as(surroundings.floor_points)
    return replace(
        surroundings,
        points=torch.cat([surroundings.points, surroundings.floor_points]),
        normals=torch.cat([surroundings.normals, up]),
        floor=None,
    )
