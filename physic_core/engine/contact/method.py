"""Settings and steps of stage 4. An energy may override some of them in a subclass."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from physic_core.engine.contact.distances import (
    ContactSurfaces,
    Distances,
    distance_along_normal,
    nearby_surfaces,
)
from physic_core.engine.contact.probability import (
    contact_model,
    contact_parts,
    feature_columns,
    scene_contact,
)
from physic_core.engine.ground.touch import LEAST_PROBABILITY
from physic_core.geometry.visibility import front_depth, in_free_space
from physic_core.types.bounds import Share

if TYPE_CHECKING:
    from physic_core.engine.scene_state import Surroundings
    from physic_core.engine.state import State


@dataclass(frozen=True)
class Touch:
    """Contact of the vertices of N people.

    Attributes:
        kind: (N, V) int64, index into ``KINDS``; -1 without contact.
        probability: (N, V) of contact with anything; None if the method estimates none.
        parts: body part -> (N,) probability that it touches scene or floor; empty if the method
            estimates none. See :mod:`physic_core.engine.contact.probability`.
    """

    kind: Tensor
    probability: Tensor | None
    parts: Mapping[str, Tensor] = field(default_factory=dict)

    @staticmethod
    def of_rank(rank: Tensor, touches: Tensor, probability: Tensor | None) -> Touch:
        """Return the kind of contact with the highest rank (K, N, V) where a vertex ``touches`` (N,
        V) bool.
        """
        return Touch(torch.where(touches, rank.argmax(0), -1), probability)


@dataclass(frozen=True)
class ContactMethod:
    """Stage 4 of preset "default": what each vertex touches, and what supports each person."""

    threshold: Share = 0.35
    """Minimum probability of a vertex in contact.

    0.35 has the best F1 on held-out worlds, both for visible and for invisible limbs.
    """
    skin_threshold: Share = 0.16
    """The same for contact with other people and with the person's own body, which is less certain.

    0.16 has an F1 of .21 there, and 0.12 one of .22, with half more vertices on body parts that
    touch no skin.
    """
    people: bool = True
    """Whether to estimate contact with other people and with the person's own body."""
    assume_supports: bool = True
    """Whether people without support in the scene may touch a hidden support, such as a seat or a
    bar in their hands (:mod:`physic_core.engine.contact.support`).
    """

    def surfaces(self, around: Surroundings, vertices: Tensor, scale: float) -> ContactSurfaces:
        """Return what bodies (N, V, 3), metres, may touch: the scaled scene near them, and the
        plane of the floor.
        """
        normal = around.floor_normal
        floor = None if normal is None else (normal, around.floor_offset * scale)
        return nearby_surfaces(around, vertices, scale, floor)

    def free_vertices(self, state: State, around: Surroundings) -> Tensor | None:
        """Return the vertices (N, V) bool in space that the photo shows to be free; None if no
        depth is known.
        """
        if around.depth is None:
            return None
        return in_free_space(state.vertices / state.scene_scale, front_depth(around.depth), state.K)

    def measure(self, offsets: Tensor, normals: Tensor, distance: Tensor) -> Tensor:
        """Return the distance of vertices to the scene; arguments as in ``DistanceMeasure``."""
        return distance_along_normal(offsets, normals, distance)

    def touch(self, state: State, near: Distances) -> Touch:
        """Return the contacts of vertices whose fitted probability is at least the threshold.

        A vertex touches scene or floor only if its body part does.
        """
        probabilities = contact_model().probabilities(feature_columns(state, near))
        probabilities[0], parts = scene_contact(state, near)
        apart = torch.zeros_like(state.vertices[..., 0], dtype=torch.bool)
        for name, chosen in contact_parts(state.model).items():
            apart |= (parts[name] < LEAST_PROBABILITY)[:, None] & chosen
        in_reach = torch.isfinite(near.by_kind)
        may_touch = state.model.outer & state.finite[:, None]
        likely = torch.where(may_touch, 1 - (1 - probabilities).prod(0), 0.0)
        rank = torch.where(in_reach, probabilities, -1.0)
        skin = torch.where(in_reach, probabilities, 0.0)[1:].amax(0)
        on_skin = (skin >= self.skin_threshold) & (rank.argmax(0) > 0)
        elsewhere = (rank.argmax(0) > 0) | ~apart
        touches = ((likely >= self.threshold) & in_reach.any(0) & elsewhere) | on_skin
        return replace(Touch.of_rank(rank, touches & may_touch, likely), parts=parts)
