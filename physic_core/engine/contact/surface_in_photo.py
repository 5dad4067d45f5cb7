"""What the picture shows beside feet, hands and buttocks of which the scene has no surface near
them.

What surrounds a part in the picture may lie far behind it. So the label names only what usually
carries such a part.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from physic_core.engine.body_parts import SEAT
from physic_core.engine.contact.parts import SAT_ON
from physic_core.engine.photo_content import FEWEST_PIXELS
from physic_core.geometry.camera import project
from physic_core.geometry.pixels import dilate_square
from physic_core.types.people import GROUND_SURFACES

if TYPE_CHECKING:
    from physic_core.engine.photo_content import PhotoContent
    from physic_core.engine.state import State

_CARRIES = {
    "foot": (*GROUND_SURFACES, "stairs", "seat", "bed", "table", "vehicle"),
    "hand": ("seat", "bed", "table", "cabinet", "vehicle"),
    "seat": SAT_ON,
}
"""Kind of part -> labels that may name what it touches."""

_REACH = 0.08  # of the height of a person's mask: pixels around a part
_LEAST_SHARE = 0.3  # of the pixels around a part with a label that names what it touches


@dataclass(frozen=True)
class PeopleInPhoto:
    """Where N people are in their photo.

    Attributes:
        photo: of the people.
        points: (N, V, 2) px of the vertices.
        on_visible_limb: (N, V) bool, vertices on limbs that the photo shows.
    """

    photo: PhotoContent
    points: Tensor
    on_visible_limb: Tensor

    @classmethod
    def of(cls, photo: PhotoContent, state: State) -> PeopleInPhoto:
        """Return where the people of a state are with their final bodies."""
        return cls(photo, project(state.vertices, state.K), state.visible_vertices)

    def carrier_name_of_part(self, person: int, part: str, skin: Tensor) -> str | None:
        """Return the name of what carries a part of a person: a label, "seat" below buttocks beside
        no such label, and "" beside other parts. None if the picture does not show what is around
        the part, and of other parts.

        Args:
            person: row.
            part: name.
            skin: (V,) bool, vertices of the part.
        """
        carrier_labels = _CARRIES.get(part.rpartition("_")[2])
        if carrier_labels is None:
            return None
        photo = self.photo
        labels = photo.labels[self._pixels_around(person, skin) & ~photo.hole]
        if len(labels) < FEWEST_PIXELS:
            return None
        share = torch.bincount(labels, minlength=len(photo.label_names)) / len(labels)
        shares = dict(zip(photo.label_names, share.tolist(), strict=True))
        best = max(carrier_labels, key=lambda name: shares.get(name, 0.0))
        if shares.get(best, 0.0) >= _LEAST_SHARE:
            return best
        return "seat" if part == SEAT else ""

    def _pixels_around(self, person: int, skin: Tensor) -> Tensor:
        """Return the pixels (H, W) bool of skin (V,) bool of a person, and around it."""
        height, width = self.photo.hole.shape
        pixels = torch.zeros_like(self.photo.hole)
        points = self.points[person, skin]
        columns, rows = points[torch.isfinite(points).all(1)].round().long().unbind(1)
        inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        pixels[rows[inside], columns[inside]] = True
        return dilate_square(
            pixels, max(2, round(_REACH * int(self.photo.masks[person].any(1).sum())))
        )
