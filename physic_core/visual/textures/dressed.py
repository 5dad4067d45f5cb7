"""People as pictures, page and GLB show them: the photo's colours where it shows them, and a neutral tone elsewhere.

Between the two, the colour fades over a few centimetres of skin. The neutral tone has a light of its own, since the
photo's colours, which have theirs, are drawn without one.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, wraps
from threading import Lock
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from physic_core.body import load_body
from physic_core.geometry.mesh import vertex_normals
from physic_core.geometry.upright import up_in_camera
from physic_core.visual.palette import BODY_RGB
from physic_core.visual.textures.photo import caster_of_bodies, photo_colors
from physic_core.visual.textures.raster import (
    TextureCoordinates,
    TextureRaster,
    load_texture_coordinates,
    rasterize_texture,
)

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

_Made = TypeVar("_Made")

_SURE = 0.5  # weight of the photo from which a vertex gives its colour to those beside it
_LIGHT, _DARK = 1.1, 0.55  # of the neutral tone towards the light and away from it


@dataclass(frozen=True)
class DressedBodies:
    """Colours of the people of a result.

    Attributes:
        colors: person -> (V, 3) uint8 sRGB of each vertex, of those with a body.
        beside: person -> (V, 3) the same where no photo shows the vertex, 0-255.
        mesh: texture coordinates of the bodies; None for others than the embedded body.
        shown: person -> share of the vertices that a photo shows.
        caster: of all bodies; None without bodies.
    """

    colors: Mapping[int, UInt8Array]
    beside: Mapping[int, Array]
    mesh: TextureCoordinates | None
    shown: Mapping[int, float]
    caster: RayCaster | None


def _kept_for_next_picture(make: Callable[[Reconstruction], _Made]) -> Callable[[Reconstruction], _Made]:
    """Keep what is made of the last result, for its preview, GLB and page; threads that draw them share it."""
    last: list[tuple[weakref.ref[Reconstruction], _Made]] = []
    making = Lock()

    @wraps(make)
    def kept(result: Reconstruction) -> _Made:
        with making:
            if not last or last[0][0]() is not result:
                last[:] = [(weakref.ref(result), make(result))]
            return last[0][1]

    return kept


@_kept_for_next_picture
def dressed_bodies(result: Reconstruction) -> DressedBodies:
    """Return the colours of the people of a result."""
    caster = caster_of_bodies(result)
    if caster is None:
        return DressedBodies({}, {}, None, {}, None)
    mesh, faces = None, np.asarray(result.faces, np.int64)
    if result.body_model == "embedded":
        own = embedded_coordinates()
        if np.array_equal(own.vertex[own.faces], faces):
            mesh = own
    colors, fill, shown = dict[int, "UInt8Array"](), dict[int, "Array"](), dict[int, float]()
    for index, person in enumerate(result.people):
        if not np.isfinite(person.vertices).all():
            continue
        vertices = person.vertices.astype(np.float64)
        normals = vertex_normals(vertices, faces)
        photo, _, weight = photo_colors(result, index, vertices, normals, caster)
        tone = np.array(BODY_RGB) * (_DARK + (_LIGHT - _DARK) * (0.5 + 0.5 * normals @ _light(result)))[:, None]
        fill[index] = _faded(vertices, faces, photo, weight, tone)
        colors[index] = _mixed(photo, weight, fill[index])
        shown[index] = float((weight > _SURE).mean())
    return DressedBodies(colors, fill, mesh, shown, caster)


@_kept_for_next_picture
def dressed_images(result: Reconstruction) -> dict[int, UInt8Array]:
    """Return person -> texture (N, N, 3) uint8 sRGB; none of bodies without texture coordinates."""
    dressed, images = dressed_bodies(result), dict[int, "UInt8Array"]()
    if dressed.mesh is None or dressed.caster is None:
        return images
    faces = np.asarray(result.faces, np.int64)
    for index, beside in dressed.beside.items():
        raster, vertices = embedded_raster(_size(result, index)), result.people[index].vertices.astype(np.float64)
        points, normals = (raster.interpolate(faces, values) for values in (vertices, vertex_normals(vertices, faces)))
        photo, _, weight = photo_colors(result, index, points, normals, dressed.caster)
        images[index] = raster.image(_mixed(photo, weight, raster.interpolate(faces, beside)))
    return images


def image_of_vertices(colors: UInt8Array, size: int) -> UInt8Array:
    """Return colours (V, 3) of the vertices of an embedded body as a texture (size, size, 3)."""
    raster, mesh = embedded_raster(size), embedded_coordinates()
    made = raster.interpolate(mesh.vertex[mesh.faces], colors.astype(np.float64))
    image: UInt8Array = raster.image(np.round(made).astype(np.uint8))
    return image


@lru_cache(maxsize=1)
def embedded_coordinates() -> TextureCoordinates:
    """Return the texture coordinates of the embedded body."""
    return load_texture_coordinates("embedded", load_body("embedded").faces.numpy())


@lru_cache(maxsize=len(SIZES))
def embedded_raster(size: int) -> TextureRaster:
    """Return the texels of the embedded body in a texture of ``size`` x ``size``."""
    return rasterize_texture(embedded_coordinates(), size)


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
    tallest = _height(result.people[index].mask)
    return next((size for size in SIZES if size >= tallest), SIZES[-1])


def _height(mask: NDArray[np.bool_]) -> int:
    """Return the number of rows of a mask (H, W) between its first and its last."""
    rows = np.flatnonzero(mask.any(1))
    return int(np.ptp(rows)) + 1 if len(rows) else 0
