"""Colours of the bodies in a file: those of the photo with guessed clothes, plain, or of
contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.files import embedded_arrays, smplx_arrays
from physic_core.errors import InputError, PhysicError
from physic_core.visual.palette import BODY_RGB, contact_colors
from physic_core.visual.rig import body_of_result
from physic_core.visual.textures.dressed import dressed_bodies, dressed_texture
from physic_core.visual.textures.photo import encode_image
from physic_core.visual.textures.raster import (
    TextureCoordinates,
    TextureRaster,
    load_texture_coordinates,
    rasterize_texture,
)

if TYPE_CHECKING:
    from physic_core import ExportRequest
    from physic_core.types import Reconstruction, UInt8Array


@dataclass(frozen=True)
class TexturedBodies:
    """Texture coordinates of a result's bodies, and their textures, which are made when they are
    read.

    Attributes:
        result: of the photo.
        source: "embedded", or the path of the SMPL-X file.
        size: texels along a side of a texture.
    """

    result: Reconstruction
    source: str
    size: int

    @property
    def mesh(self) -> TextureCoordinates:
        """Bodies with split vertices."""
        return _mesh(self.source)

    @property
    def raster(self) -> TextureRaster:
        """Texels of the textures."""
        return _raster(self.source, self.size)

    def photo_images(self, index: int) -> tuple[UInt8Array, UInt8Array]:
        """Return the texture (N, N, 3) sRGB of a person, and (N, N) 255 where the photo does not
        show the texel, 0 where it does.
        """
        return dressed_texture(self.result, index, self.raster, darken=False)

    def vertex_colors(self, index: int) -> UInt8Array:
        """Return the colours (V, 3) sRGB of a person, for formats without textures."""
        return np.clip(np.round(dressed_bodies(self.result).fill[index]), 0, 255).astype(np.uint8)

    def contact_image(self, index: int) -> UInt8Array:
        """Return contact of a person as a texture (N, N, 3): the colour of what is touched, or that
        of the body.
        """
        person = self.result.people[index]
        raster = self.raster
        corners = np.asarray(self.result.faces)[raster.faces]
        nearest = np.take_along_axis(corners, raster.corners.argmax(1)[:, None], 1)[:, 0]
        image: UInt8Array = raster.image(
            contact_colors(person, self.result.contact_partners)[nearest]
        )
        return image


def textured_bodies(request: ExportRequest, size: int) -> TexturedBodies:
    """Return the textures of the people of a request.

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
    _mesh(source)  # raises if there are no texture coordinates
    return TexturedBodies(result, source, size)


@lru_cache(maxsize=2)
def _mesh(source: str) -> TextureCoordinates:
    body = embedded_arrays() if source == "embedded" else smplx_arrays(source)
    return load_texture_coordinates(source, body.faces)


@lru_cache(maxsize=2)
def _raster(source: str, size: int) -> TextureRaster:
    return rasterize_texture(_mesh(source), size)


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
            return self.textured.vertex_colors(index)
        return np.tile(np.array(BODY_RGB, np.uint8), (len(person.vertices), 1))

    def pictures(self) -> dict[str, bytes]:
        """Return name -> picture of each person: the photo's colours, where they are filled, and
        contact.
        """
        made = dict[str, bytes]()
        stem = self.request.stem
        if self.textured is None:
            return made
        for index in self.request.person:
            image, filled = self.textured.photo_images(index)
            made[f"{stem}_person_{index}.jpg"] = encode_image(image, "JPEG")
            made[f"{stem}_person_{index}_filled.png"] = encode_image(filled, "PNG")
            contact = self.textured.contact_image(index)
            made[f"{stem}_person_{index}_contact.png"] = encode_image(contact, "PNG")
        return made


def skins_of(request: ExportRequest) -> Skins:
    """Return the colours of the bodies of a request; without texture coordinates they are plain,
    and a note says so.
    """
    if not request.person:
        return Skins(request, None)
    try:
        return Skins(
            request, textured_bodies(request, int(request.options.get("texture_size", 512)))
        )
    except PhysicError as error:
        return Skins(request, None, (f"the bodies have no texture: {error}",))
