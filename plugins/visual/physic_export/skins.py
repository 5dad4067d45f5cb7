"""Colours of the bodies in a file: those of the photo with guessed clothes, plain, or of
contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError, PhysicError
from physic_visual.palette import BODY_RGB, contact_colors
from physic_visual.rig import body_of_result
from physic_visual.textures.dressed import (
    dressed_bodies,
    dressed_texture,
    image_of_vertices,
    texture_coordinates,
    texture_raster,
)
from physic_visual.textures.photo import encode_image

if TYPE_CHECKING:
    from physic_core import ExportRequest
    from physic_core.types import UInt8Array
    from physic_visual.textures.raster import TextureCoordinates


@dataclass(frozen=True)
class Skins:
    """Colours of the bodies of a request; textures are made when they are read.

    Attributes:
        request: with the option ``skin``.
        source: of the texture coordinates, "embedded" or the path of the SMPL-X file; "" if the
            bodies have none.
        texels: along a side of a texture.
        notes: sentences for the user.
    """

    request: ExportRequest
    source: str = ""
    texels: int = 512
    notes: tuple[str, ...] = ()

    @property
    def mesh(self) -> TextureCoordinates | None:
        """Bodies with split vertices; None if they have no texture coordinates."""
        return texture_coordinates(self.source) if self.source else None

    @property
    def kind(self) -> str:
        """The skin that the file has: "photo", "neutral" or "contact"."""
        wanted = str(self.request.options["skin"])
        return "neutral" if wanted == "photo" and not self.source else wanted

    def vertex_colors(self, index: int) -> UInt8Array:
        """Return the sRGB colours (V, 3) of a person, for formats without textures."""
        result = self.request.result
        person = result.people[index]
        if self.kind == "contact":
            return contact_colors(person, result.contact_partners)
        if self.kind == "photo":
            fill = dressed_bodies(result).people[index].guessed_colors
            return np.clip(np.round(fill), 0, 255).astype(np.uint8)
        return np.tile(np.array(BODY_RGB, np.uint8), (len(person.vertices), 1))

    def photo_images(self, index: int) -> tuple[UInt8Array, UInt8Array]:
        """Return the texture (N, N, 3) sRGB of a person, and (N, N) 255 where the photo does not
        show the texel, 0 where it does.
        """
        raster = texture_raster(self.source, self.texels)
        return dressed_texture(self.request.result, index, raster, darken=False)

    def contact_image(self, index: int) -> UInt8Array:
        """Return contact of a person as a texture (N, N, 3): the colour of what is touched, or that
        of the body.
        """
        result = self.request.result
        colors = contact_colors(result.people[index], result.contact_partners)
        return image_of_vertices(colors, self.source, self.texels)

    def pictures(self) -> dict[str, bytes]:
        """Return name -> picture of each person: the photo's colours, where they are filled, and
        contact.
        """
        files = dict[str, bytes]()
        for index in self.request.person if self.source else ():
            name = f"{self.request.stem}_person_{index}"
            image, filled = self.photo_images(index)
            files[f"{name}.jpg"] = encode_image(image, "JPEG")
            files[f"{name}_filled.png"] = encode_image(filled, "PNG")
            files[f"{name}_contact.png"] = encode_image(self.contact_image(index), "PNG")
        return files


def skins_of(request: ExportRequest) -> Skins:
    """Return the colours of the bodies of a request; without texture coordinates they are plain,
    and a note says so.
    """
    if not request.person:
        return Skins(request)
    try:
        return textured_skins(request, int(request.options.get("texture_size", 512)))
    except PhysicError as error:
        return Skins(request, notes=(f"the bodies have no texture: {error}",))


def textured_skins(request: ExportRequest, size: int) -> Skins:
    """Return the colours of the bodies of a request, whose textures have a size.

    Raises:
        InputError: the body model of the result is not known.
        BodyModelError: the user's body model file has no texture coordinates.
    """
    result = request.result
    model = body_of_result(result, request.body_file)
    if any(len(person.vertices) != len(model.template) for _, person in request.chosen()):
        raise InputError(
            f"the bodies of the result do not have the {len(model.template)} vertices of its body "
            f"model"
        )
    source = (
        "embedded"
        if model.name == "embedded"
        else str(request.body_file or result.config["body_model"]["path"])
    )
    texture_coordinates(source)  # raises if there are none
    return Skins(request, source, size)
