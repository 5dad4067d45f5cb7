"""Input and result of stage 4: torch tensors on one device, camera frame, metres."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from physic_core.body.model import BodyModel
from physic_core.engine.contact.distance import ContactSurfaces
from physic_core.engine.contact.scene_parts import ClassifiedPoints
from physic_core.engine.limbs import observed_parts
from physic_core.types.contacts import BodyContact, ContactPartner, Support

if TYPE_CHECKING:
    from physic_core.engine.contact.objects import HeldObjects
    from physic_core.engine.stance import Stance


@dataclass(frozen=True)
class ContactInput:
    """Final bodies of N people with V vertices, and what they may touch.

    Attributes:
        model: body model of all people.
        vertices: (N, V, 3) metres.
        joints: (N, 55, 3) metres.
        prior: (N, V) of the contact prior, in [0, 1].
        observed: (N, 55) bool, visible joints.
        surfaces: scaled scene near the people, and the floor.
        classes: of the points of the scene.
        plane: unit normal (3,) of the floor, up, and offset in metres; None if no floor was found.
        free: (N, V) bool, vertices in space that the photo shows to be free; None if that is not
            used.
        objects: small objects in hands and on laps; None if people touch none.
        stance: of the people; None if unknown.
        in_mask: (N, V) bool, vertices at pixels of the person's mask; None if unknown.
    """

    model: BodyModel
    vertices: Tensor
    joints: Tensor
    prior: Tensor
    observed: Tensor
    surfaces: ContactSurfaces
    classes: ClassifiedPoints
    plane: tuple[Tensor, float] | None
    free: Tensor | None = None
    objects: HeldObjects | None = None
    stance: Stance | None = None
    in_mask: Tensor | None = None

    @property
    def up(self) -> Tensor:
        """Unit vector (3,) up; of an upright camera without a floor."""
        return (
            self.vertices.new_tensor([0.0, -1.0, 0.0])
            if self.plane is None
            else self.plane[0].to(self.vertices)
        )

    @property
    def seen(self) -> Tensor:
        """Vertices (N, V) bool of limbs that the photo shows."""
        return observed_parts(self.model.part_names, self.observed)[:, self.model.part_of_vertex]

    def part(self, *endings: str) -> Tensor:
        """Return the vertices (V,) bool of body parts whose names have this suffix."""
        chosen = torch.tensor([name.endswith(endings) for name in self.model.part_names])
        return chosen.to(self.vertices.device)[self.model.part_of_vertex]

    @property
    def finite(self) -> Tensor:
        """People (N,) bool whose vertices are finite; the others touch nothing."""
        return torch.isfinite(self.vertices).flatten(1).all(1)


@dataclass(frozen=True)
class ContactResult:
    """Contact of N people.

    Attributes:
        contact: (N, V) bool.
        probability: (N, V) of contact with anything; None if the method estimates none.
        distance: (N, V) signed distance to scene and floor, metres; inf beyond the search radius.
        partner: (N, V) int16, index into ``partners``; -1 without contact.
        partners: everything that people touch.
        contacts: per person, contacts by body part, most probable first.
        supports: per person, their support; None for non-finite vertices.
        parts: body part -> (N,) probability that it touches scene, floor or a hidden support; empty
            if the method estimates none.
        unseen: body part -> (N,) bool, no pixel shows it, and its probability is a base rate; empty
            as ``parts``.
    """

    contact: Tensor
    probability: Tensor | None
    distance: Tensor
    partner: Tensor
    partners: tuple[ContactPartner, ...]
    contacts: tuple[tuple[BodyContact, ...], ...]
    supports: tuple[Support | None, ...]
    parts: Mapping[str, Tensor] = field(default_factory=dict)
    unseen: Mapping[str, Tensor] = field(default_factory=dict)
