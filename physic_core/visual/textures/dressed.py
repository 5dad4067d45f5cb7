"""People as pictures, page and GLB show them: the photo's colours where it shows them, and a neutral tone elsewhere.

Between the two, the colour fades over a few centimetres of skin. The neutral tone has a light of its own, since the
photo's colours, which have theirs, are drawn without one.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import load_body
from physic_core.geometry.mesh import vertex_normals
from physic_core.geometry.upright import up_in_camera
from physic_core.visual.palette import BODY_RGB
from physic_core.visual.textures.coordinates import TextureCoordinates, load_texture_coordinates
from physic_core.visual.textures.photo import caster_of_bodies, photo_colors
from physic_core.visual.textures.raster import TextureRaster, rasterize

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.geometry.rays import RayCaster
    from physic_core.types import Reconstruction, UInt8Array

    Array = NDArray[np.float64]

SIZES = (128, 256, 512)
"""Texels along a side of a texture: at least as many as the person has px in height, up to the last. A texel of 512 is
3 mm of skin."""

FADE_M = 0.06
"""Way over the skin on which the photo's colours fade to the neutral tone, metres."""

_SURE = 0.5  # weight of the photo from which a vertex gives its colour to those beside it
_LIGHT, _DARK = 1.1, 0.55  # of the neutral tone towards the light and away from it


@dataclass(frozen=True)
class DressedBodies:
    """Colours of the people of a result.

    Attributes:
        colors: person -> (V, 3) uint8 sRGB of each vertex, of those with a body.
        mesh: texture coordinates of the bodies; None for others than the embedded body.
        images: person -> (N, N, 3) uint8 sRGB, their textures; empty without ``mesh``.
        shown: person -> share of the vertices that a photo shows.
    """

    colors: Mapping[int, UInt8Array]
    mesh: TextureCoordinates | None
    images: Mapping[int, UInt8Array]
    shown: Mapping[int, float]

    def image_of(self, values: UInt8Array, size: int) -> UInt8Array:
        """Return colours (V, 3) of vertices as a texture (size, size, 3)."""
        raster = embedded_raster(size)
        corners = embedded_coordinates().vertex[embedded_coordinates().faces]
        made = raster.interpolate(corners, values.astype(np.float64))
        image: UInt8Array = raster.image(np.round(made).astype(np.uint8))
        return image


_last: tuple[weakref.ref[Reconstruction], DressedBodies] | None = None


def dressed_bodies(result: Reconstruction) -> DressedBodies:
    """Return the colours of the people of a result; those of the last result are kept for its next picture."""
    global _last
    if _last is not None and _last[0]() is result:
        return _last[1]
    made = _dress(result)
    _last = weakref.ref(result), made
    return made


@lru_cache(maxsize=1)
def embedded_coordinates() -> TextureCoordinates:
    """Return the texture coordinates of the embedded body."""
    return load_texture_coordinates("embedded", load_body("embedded").faces.numpy())


@lru_cache(maxsize=len(SIZES))
def embedded_raster(size: int) -> TextureRaster:
    """Return the texels of the embedded body in a texture of ``size`` x ``size``."""
    return rasterize(embedded_coordinates(), size)


def _dress(result: Reconstruction) -> DressedBodies:
    posed = [i for i, person in enumerate(result.people) if np.isfinite(person.vertices).all()]
    caster = caster_of_bodies(result)
    if caster is None:
        return DressedBodies({}, None, {}, {})
    mesh = None
    if result.body_model == "embedded":
        own = embedded_coordinates()
        if np.array_equal(own.vertex[own.faces], result.faces):
            mesh = own
    colors, images, shown = dict[int, "UInt8Array"](), dict[int, "UInt8Array"](), dict[int, float]()
    for index in posed:
        raster = None if mesh is None else embedded_raster(_size(result, index))
        colors[index], shown[index], image = _dress_person(result, index, caster, raster)
        if image is not None:
            images[index] = image
    return DressedBodies(colors, mesh, images, shown)


def _dress_person(
    result: Reconstruction, index: int, caster: RayCaster, raster: TextureRaster | None
) -> tuple[UInt8Array, float, UInt8Array | None]:
    """Return the colours of the vertices of a person, the share that a photo shows, and the texture."""
    faces, vertices = np.asarray(result.faces, np.int64), result.people[index].vertices.astype(np.float64)
    count, normals = len(vertices), vertex_normals(vertices, faces)
    points, outwards = vertices, normals
    if raster is not None:
        points = np.concatenate([vertices, raster.interpolate(faces, vertices)])
        outwards = np.concatenate([normals, raster.interpolate(faces, normals)])
    photo, _, weight = photo_colors(result, index, points, outwards, caster)
    tone = np.array(BODY_RGB) * (_DARK + (_LIGHT - _DARK) * (0.5 + 0.5 * normals @ _light(result)))[:, None]
    beside = _faded(vertices, faces, photo[:count], weight[:count], tone)
    colors = _mixed(photo[:count], weight[:count], beside)
    image: UInt8Array | None = None
    if raster is not None:
        image = raster.image(_mixed(photo[count:], weight[count:], raster.interpolate(faces, beside)))
    return colors, float((weight[:count] > _SURE).mean()), image


def _faded(vertices: Array, faces: NDArray[np.int64], photo: Array, weight: Array, tone: Array) -> Array:
    """Return colours (V, 3) that fade from those of the nearest vertex that the photo shows to the neutral tone."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    sure = np.flatnonzero(weight > _SURE)
    if not len(sure):
        return tone
    start, end = faces.T.ravel(), faces[:, [1, 2, 0]].T.ravel()  # two faces have an edge in opposite directions
    length = np.linalg.norm(vertices[start] - vertices[end], axis=1)
    graph = coo_array((np.maximum(length, 1e-6), (start, end)), shape=(len(vertices),) * 2).tocsr()
    way, _, source = dijkstra(graph, False, sure, limit=FADE_M, min_only=True, return_predecessors=True)
    share = np.cos(np.pi / 2 * np.minimum(way / FADE_M, 1))[:, None] ** 2
    colors: Array = share * photo[np.maximum(source, 0)] + (1 - share) * tone  # what is out of reach has no source
    return colors


def _mixed(photo: Array, weight: Array, beside: Array) -> UInt8Array:
    """Return the colours of the photo by their weight (n,), and others for the rest."""
    blend = np.minimum(weight, 1)[:, None]
    return np.clip(np.round(blend * photo + (1 - blend) * beside), 0, 255).astype(np.uint8)


def _light(result: Reconstruction) -> Array:
    """Return the direction (3,) towards the light of the neutral tone, from above and the left, camera frame."""
    up = np.asarray(up_in_camera(result.scene.floor), np.float64)
    light = 0.8 * up - [0.6, 0.0, 0.0]
    unit: Array = light / np.linalg.norm(light)
    return unit


def _size(result: Reconstruction, index: int) -> int:
    """Return the size of the texture of a person."""
    masks = [view.people[index].mask for view in result.cameras if index in view.people]
    tallest = max(map(_height, [result.people[index].mask, *masks]))
    return next((size for size in SIZES if size >= tallest), SIZES[-1])


def _height(mask: NDArray[np.bool_]) -> int:
    """Return the number of rows of a mask (H, W) between its first and its last."""
    rows = np.flatnonzero(mask.any(1))
    return int(np.ptp(rows)) + 1 if len(rows) else 0
