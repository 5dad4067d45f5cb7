"""Settings and steps of stage 4. An energy may override some of them in a subclass."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from physic_core.engine.contact.distances import (
    HAND_BREADTH_M,
    SEARCH_RADIUS_M,
    ContactSurfaces,
    Distances,
)
from physic_core.engine.contact.probability import (
    held_object_probability,
    scene_contact_probability,
    scene_proximity,
    skin_contact_probability,
    values_by_vertex,
    vertex_shares,
)
from physic_core.geometry.neighbors import NearestPointSearch, inside_body_boxes
from physic_core.geometry.visibility import front_depth, in_free_space
from physic_core.types.bounds import Share
from physic_core.types.observations import LEAST_PROBABILITY

if TYPE_CHECKING:
    from physic_core.engine.scene_state import Surroundings
    from physic_core.engine.state import State

# Spacing of scene points: a vertex between four of them is on the surface, not 1 cm from it.
_POINT_SPACING_M = 0.02


@dataclass(frozen=True)
class Touch:
    """Contact of the vertices of N people.

    Attributes:
        kind: (N, V) int64, index into ``KINDS``; -1 without contact.
        probability: (N, V) of contact with what ``kind`` says, and with scene or floor without;
            None if the method estimates none.
        part_probability: body part -> (N,) probability that it touches scene or floor; empty if
            the method estimates none. See :mod:`physic_core.engine.contact.probability`.
        gaps: body part -> (N,) its distance from the nearest surface, metres; inf beyond the radius
            of the search.
    """

    kind: Tensor
    probability: Tensor | None
    part_probability: Mapping[str, Tensor] = field(default_factory=dict)
    gaps: Mapping[str, Tensor] = field(default_factory=dict)


@dataclass(frozen=True)
class ContactStageMethod:
    """Stage 4 of preset "default": what each vertex touches, and what supports each person."""

    threshold: Share = 0.35
    """Minimum probability of a vertex in contact.

    0.35 has the best F1 on held-out worlds, both for visible and for invisible limbs.
    """
    people: bool = True
    """Whether to estimate contact with other people and with the person's own body."""
    assume_supports: bool = True
    """Whether people without support in the scene may touch a hidden support, such as a seat or a
    bar in their hands (:mod:`physic_core.engine.contact.support`).
    """

    def surfaces(
        self, surroundings: Surroundings, vertices: Tensor, scale: float
    ) -> ContactSurfaces:
        """Return what bodies (N, V, 3), metres, may touch: the scaled scene near them, and the
        plane of the floor.
        """
        points = surroundings.points * scale
        is_near = inside_body_boxes(points, vertices, SEARCH_RADIUS_M)
        scene = NearestPointSearch(points[is_near], surroundings.normals[is_near], SEARCH_RADIUS_M)
        floor = surroundings.floor and surroundings.floor.scaled(scale)
        return ContactSurfaces(scene, is_near.nonzero(as_tuple=True)[0], floor)

    def free_vertices(self, state: State) -> Tensor | None:
        """Return the vertices (N, V) bool in space that the photo shows to be free; None if the
        method does not ask.
        """
        depth = front_depth(state.scene.depth.to(state.transl))
        return in_free_space(state.vertices / state.unapplied_scene_scale, depth, state.K)

    def measure(self, offsets: Tensor, normals: Tensor, distance: Tensor) -> Tensor:
        """Return the distance of vertices to the scene; arguments as in ``DistanceMeasure``.

        It is measured along the normal of the nearest point, with the lateral distance beyond the
        rim of a surface.
        """
        normal_distance = (normals * offsets).sum(-1)
        lateral = (offsets - normal_distance[..., None] * normals).norm(dim=-1)
        plane = torch.sqrt(
            normal_distance.square() + torch.relu(lateral - _POINT_SPACING_M).square()
        )
        return torch.where(normals.square().sum(-1) > 0.5, plane, distance)

    def find_touch(self, state: State, near: Distances) -> Touch:
        """Return the contacts of vertices whose fitted probability is at least the threshold.

        A vertex touches only what its body part touches, of the scene nothing farther than a hand's
        breadth.
        """
        proximity = scene_proximity(state, near)
        part_probability = scene_contact_probability(state, proximity)
        by_part = values_by_vertex(state.model, part_probability)
        on_scene = by_part * vertex_shares(state.model, proximity)
        on_skin = skin_contact_probability(near).to(on_scene)
        on_object = held_object_probability(state)[None]
        probabilities = torch.cat([on_scene[None], on_skin, on_object])
        possible = torch.cat([by_part[None], on_skin, on_object]) >= LEAST_PROBABILITY
        possible[0] &= near.surface.nearest <= HAND_BREADTH_M
        possible &= state.model.outer & state.finite_people[:, None]
        rank = torch.where(possible, probabilities, -1.0)
        touches = rank.amax(0) >= self.threshold
        probability = torch.where(touches, rank.amax(0), on_scene.nan_to_num())
        kind = torch.where(touches, rank.argmax(0), -1)
        return Touch(
            kind,
            probability,
            part_probability,
            gaps=dict(zip(part_probability, proximity.gap.T, strict=True)),
        )
