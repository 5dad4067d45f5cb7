"""Colours of the bodies in a file: those of the photo, plain, or of contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import PhysicError
from physic_core.visual.palette import BODY_RGB, contact_colors
from physic_core.visual.textures.pictures import encode_image
from physic_export.textured_bodies import TexturedBodies, textured_bodies

if TYPE_CHECKING:
    from physic_core import ExportRequest
    from physic_core.types import UInt8Array


@dataclass(frozen=True)
class Skins:
    """Colours of the bodies of a request.

    Attributes:
        request: with the option ``skin``.
        textured: None if the bodies have no texture coordinates.
        notes: sentences for the user.
    """

    request: ExportRequest
    textured: TexturedBodies | None
    notes: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """The skin that the file has: "photo", "neutral" or "contact"."""
        wanted = str(self.request.options["skin"])
        return "neutral" if wanted == "photo" and self.textured is None else wanted

    def vertex_colors(self, index: int) -> UInt8Array:
        """Return the sRGB colours (V, 3) of a person."""
        person = self.request.result.people[index]
        if self.kind == "contact":
            return contact_colors(person, self.request.result.contact_partners)
        if self.kind == "photo" and self.textured is not None:
            return self.textured.textures[index].vertex_colors
        return np.tile(np.array(BODY_RGB, np.uint8), (len(person.vertices), 1))

    def pictures(self) -> dict[str, bytes]:
        """Return name -> picture of each person: the photo's colours, where they are filled, and contact."""
        made, stem = dict[str, bytes](), self.request.stem
        if self.textured is None:
            return made
        for index in self.request.people:
            texture = self.textured.textures[index]
            made[f"{stem}_person_{index}.jpg"] = encode_image(texture.image, "JPEG")
            made[f"{stem}_person_{index}_filled.png"] = encode_image(texture.filled, "PNG")
            contact = self.textured.contact_image(self.request.result, index)
            made[f"{stem}_person_{index}_contact.png"] = encode_image(contact, "PNG")
        return made


def skins_of(request: ExportRequest) -> Skins:
    """Return the colours of the bodies of a request; without texture coordinates they are plain, and a note says so."""
    if not request.people:
        return Skins(request, None)
    try:
        return Skins(request, textured_bodies(request, int(request.options.get("texture_size", 512))))
    except PhysicError as error:
        return Skins(request, None, (f"the bodies have no texture: {error}",))
