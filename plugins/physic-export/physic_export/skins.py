"""Colours of the bodies in a file: those of the photo, plain, or of contact.

A texel that the photo shows has the photo's colour; the weight falls where the surface turns away from the camera. The
rest is filled: with the other side of the body where the photo shows that, and over the surface between, towards the
mean of the body part.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import load_body
from physic_core.errors import InputError, PhysicError
from physic_core.geometry.mesh import vertex_normals
from physic_core.visual.palette import BODY_RGB, contact_colors
from physic_core.visual.rig import body_of_result
from physic_core.visual.textures.photo import NEAREST_WEIGHT, caster_of_bodies, encode_image, photo_colors
from physic_core.visual.textures.raster import (
    TextureCoordinates,
    TextureRaster,
    load_texture_coordinates,
    rasterize_texture,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core import ExportRequest
    from physic_core.body.model import BodyModel
    from physic_core.geometry.rays import RayCaster
    from physic_core.types import Reconstruction, UInt8Array

    Array = NDArray[np.float64]

MIRROR_WEIGHT, PART_WEIGHT = 0.3, 0.002
"""Weights of the other side and of the part's mean against what the photo shows."""


@dataclass(frozen=True)
class BodyTexture:
    """Texture of one person.

    Attributes:
        image: (N, N, 3) uint8 sRGB.
        filled: (N, N) uint8, 255 where the photo does not show the texel, 0 where it does.
        vertex_colors: (V, 3) uint8 sRGB, the same for formats without textures.
        vertex_filled: (V,) float32 in 0-1.
        shown: share of the body's surface that the photo shows.
    """

    image: UInt8Array
    filled: UInt8Array
    vertex_colors: UInt8Array
    vertex_filled: NDArray[np.float32]
    shown: float


@dataclass(frozen=True)
class TexturedBodies:
    """Texture coordinates of a result's bodies, and a texture per person.

    Attributes:
        mesh: with split vertices.
        raster: of the textures.
        textures: person -> texture.
    """

    mesh: TextureCoordinates
    raster: TextureRaster
    textures: dict[int, BodyTexture]

    def contact_image(self, result: Reconstruction, index: int) -> UInt8Array:
        """Return contact of a person as a texture (N, N, 3): the colour of what is touched, or that of the body."""
        person = result.people[index]
        nearest = np.take_along_axis(
            np.asarray(result.faces)[self.raster.faces], self.raster.corners.argmax(1)[:, None], 1
        )[:, 0]
        image: UInt8Array = self.raster.image(contact_colors(person, result.contact_partners, BODY_RGB)[nearest])
        return image


def textured_bodies(request: ExportRequest, size: int) -> TexturedBodies:
    """Return the textures of the people of a request.

    Raises:
        InputError: the body model of the result is not known.
        BodyModelError: the user's body model file has no texture coordinates.
    """
    result = request.result
    model = body_of_result(result, request.body_file)
    if any(len(person.vertices) != model.num_vertices for _, person in request.chosen()):
        raise InputError(f"the bodies of the result do not have the {model.num_vertices} vertices of its body model")
    source = "embedded" if model.name == "embedded" else str(request.body_file or result.config["body_model"]["path"])
    mesh, raster = _mesh(source, size)
    caster = caster_of_bodies(result)
    textures = {index: _texture(result, index, model, raster, caster) for index, _ in request.chosen() if caster}
    return TexturedBodies(mesh, raster, textures)


@lru_cache(maxsize=2)
def _mesh(source: str, size: int) -> tuple[TextureCoordinates, TextureRaster]:
    faces = load_body(source if source == "embedded" else Path(source)).faces.numpy()
    mesh = load_texture_coordinates(source, faces)
    return mesh, rasterize_texture(mesh, size)


def _texture(
    result: Reconstruction, index: int, model: BodyModel, raster: TextureRaster, caster: RayCaster
) -> BodyTexture:
    person = result.people[index]
    faces, vertices = np.asarray(result.faces, np.int64), person.vertices.astype(np.float64)
    points = raster.interpolate(faces, vertices)
    normals = raster.interpolate(faces, vertex_normals(vertices, faces))
    photo, seen, near = photo_colors(result, index, points, normals, caster)
    weight = np.maximum(seen, NEAREST_WEIGHT * near)
    colors = _fill(photo, weight, raster, faces, model)
    share = raster.interpolate(faces, colors)
    blend = np.minimum(weight, 1)[:, None]
    image = blend * photo + (1 - blend) * share
    vertex_seen = _vertex_means(seen[:, None], np.ones(len(seen)), raster, faces, len(vertices))[0][:, 0]
    area = _texel_areas(raster, faces, vertices)
    return BodyTexture(
        raster.image(np.clip(np.round(image), 0, 255).astype(np.uint8)),
        raster.image(np.round(255 * (1 - seen)).astype(np.uint8)),
        np.clip(np.round(colors), 0, 255).astype(np.uint8),
        (1 - vertex_seen).astype(np.float32),
        float((area * (seen > 0.5)).sum() / max(area.sum(), 1e-12)),
    )


def _vertex_means(
    values: Array, weight: Array, raster: TextureRaster, faces: NDArray[np.int64], count: int
) -> tuple[Array, Array]:
    """Return weighted means (V, C) of texel values (n, C) at the vertices, and the mean weight (V,) of their texels."""
    index = faces[raster.faces].ravel()
    near = raster.corners.ravel()
    total = np.bincount(index, near * np.repeat(weight, 3), count)
    texels = np.bincount(index, near, count)
    sums = [np.bincount(index, near * np.repeat(weight * column, 3), count) for column in values.T]
    return np.stack(sums, 1) / np.maximum(total, 1e-9)[:, None], total / np.maximum(texels, 1e-9)


def _fill(photo: Array, weight: Array, raster: TextureRaster, faces: NDArray[np.int64], model: BodyModel) -> Array:
    """Return a colour (V, 3) of each vertex: the photo's, the other side's, and smooth between.

    It minimises ``sum w (c - seen)^2 + sum over edges (c_i - c_j)^2 + p (c - mean of the part)^2``.
    """
    import scipy.sparse as sp
    from scipy.sparse.linalg import splu
    from scipy.spatial import cKDTree

    count = model.num_vertices
    seen, sure = _vertex_means(photo, weight, raster, faces, count)
    if not (sure > 0).any():
        return np.tile(np.array(BODY_RGB, np.float64), (count, 1))
    rest = model.skin.template.T.double().numpy()
    other = cKDTree(rest).query(rest * [-1.0, 1.0, 1.0])[1]
    from_other = (sure < MIRROR_WEIGHT) & (sure[other] > MIRROR_WEIGHT)
    target = np.where(from_other[:, None], seen[other], seen)
    trust = np.where(from_other, MIRROR_WEIGHT * sure[other], sure)
    parts = model.part_of_vertex.numpy()
    size = int(parts.max()) + 1
    amount = np.bincount(parts, trust, size)
    mean = (trust[:, None] * target).sum(0) / trust.sum()
    of_part = np.stack([np.bincount(parts, trust * column, size) for column in target.T], 1)
    of_part = (of_part + 1e-3 * mean) / (amount + 1e-3)[:, None]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    links = sp.coo_matrix((np.ones(len(edges)), tuple(edges.T)), (count, count)).tocsr()
    links = ((links + links.T) > 0).astype(np.float64)
    laplacian = sp.diags(np.asarray(links.sum(1)).ravel()) - links
    system = splu((laplacian + sp.diags(10 * trust + PART_WEIGHT)).tocsc())
    solved: Array = system.solve(10 * trust[:, None] * target + PART_WEIGHT * of_part[parts])
    return solved


def _texel_areas(raster: TextureRaster, faces: NDArray[np.int64], vertices: Array) -> Array:
    """Return the area (n,) of the surface that each texel stands for, square metres."""
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    texels = np.bincount(raster.faces, minlength=len(faces))
    areas: Array = (area / np.maximum(texels, 1))[raster.faces]
    return areas


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
