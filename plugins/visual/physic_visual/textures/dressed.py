"""People as pictures, page and GLB show them: the photo's colours where it shows them, and guessed
clothes elsewhere.

What no photo shows is filled: with the other side of the body where the photo shows that, and over
the surface between, towards the mean of the body part. The guess is darker, and has a light of its
own, since the photo's colours, which have theirs, are drawn without one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import embedded_arrays, smplx_arrays
from physic_core.geometry import up_in_camera, vertex_areas, vertex_normals
from physic_visual.palette import BODY_RGB
from physic_visual.render import prepare_meshes
from physic_visual.rig import body_at_hand
from physic_visual.scene_mesh import cached_for_last_result
from physic_visual.textures.photo import SHOWN, photo_colors, photo_weights
from physic_visual.textures.raster import (
    TextureCoordinates,
    TextureRaster,
    load_texture_coordinates,
    rasterize_texture,
)

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

    from physic_core.body import BodyArrays
    from physic_core.geometry import RayCaster
    from physic_core.types import Float32Array, Float64Array, Int64Array, Reconstruction, UInt8Array


SIZES = (128, 256, 512)
"""Texels along a side of a texture: at least as many as the person has px in height, up to the
last. A texel of 512 is 3 mm of skin.
"""

MIRROR_WEIGHT = 0.3
PART_WEIGHT = 0.002
"""Weights of the other side and of the part's mean, against what the photo shows."""

GUESSED = "darker: guessed, not visible in the photo"
"""What a legend says of the clothes that no photo shows."""

_LIGHT = 0.9  # brightness of guessed skin towards the light
_DARK = 0.55  # the same away from it


@dataclass(frozen=True)
class DressedBody:
    """Colours of a person.

    Attributes:
        vertices: (V, 3) metres, camera frame.
        normals: (V, 3) of those.
        photo_weight: (V,) see :func:`photo_weights`.
        guessed_colors: (V, 3) sRGB 0-255, guessed where no photo shows the vertex, not darkened.
        colors: (V, 3) uint8 sRGB of each vertex.
        guessed_share: (V,) float32 in 0-1, how much of the colour is guessed.
        shown_share: share of the body's surface that a photo shows.
    """

    vertices: Float64Array
    normals: Float64Array
    photo_weight: Float64Array
    guessed_colors: Float64Array
    colors: UInt8Array
    guessed_share: Float32Array
    shown_share: float


@dataclass(frozen=True)
class DressedBodies:
    """The people of a result as pictures show them.

    Attributes:
        people: index of each person with a body -> the dressed body.
        mesh: texture coordinates of the bodies; None for others than the embedded body.
        caster: meshes of all, without triangles of an implausible length; None without bodies.
    """

    people: Mapping[int, DressedBody]
    mesh: TextureCoordinates | None = None
    caster: RayCaster | None = None


@cached_for_last_result
def dressed_bodies(result: Reconstruction) -> DressedBodies:
    """Return the colours of the people of a result."""
    posed = [index for index, person in enumerate(result.people) if person.has_body]
    if not posed:
        return DressedBodies({})
    faces = np.asarray(result.faces, np.int64)
    model = body_at_hand(result)
    skins = {index: result.people[index].vertices.astype(np.float64) for index in posed}
    bodies = prepare_meshes([*skins.values()], faces)
    others, parts = _sides_and_parts(model, len(skins[posed[0]]))
    laplacian = _laplacian(faces, len(others))
    people = {}
    for index, vertices in skins.items():
        normals = vertex_normals(vertices, faces)
        weight = photo_weights(vertices, normals, bodies)
        photo, visible_share, near = photo_colors(result, index, vertices, weight)
        fill = _fill(photo, near, laplacian, others, parts)
        areas = vertex_areas(vertices, faces)
        people[index] = DressedBody(
            vertices,
            normals,
            weight,
            fill,
            colors=_blend_with_photo(photo, near, _shaded_skin(fill, normals, result)),
            guessed_share=(1 - visible_share).astype(np.float32),
            shown_share=float(areas[visible_share > SHOWN].sum() / max(areas.sum(), 1e-12)),
        )
    is_embedded = model is not None and model.name == "embedded"
    return DressedBodies(people, texture_coordinates("embedded") if is_embedded else None, bodies)


@cached_for_last_result
def dressed_images(result: Reconstruction) -> dict[int, UInt8Array]:
    """Return person -> texture (N, N, 3) uint8 sRGB; none of bodies without texture coordinates."""
    dressed = dressed_bodies(result)
    images = dict[int, "UInt8Array"]()
    if dressed.mesh is not None:
        for index in dressed.people:
            raster = texture_raster("embedded", _texture_size(result, index))
            images[index] = dressed_texture(result, index, raster)[0]
    return images


def dressed_texture(
    result: Reconstruction, index: int, raster: TextureRaster, *, darken: bool = True
) -> tuple[UInt8Array, UInt8Array]:
    """Return the texture (N, N, 3) uint8 sRGB of a person with a body, and (N, N) 255 where no
    photo shows it, else 0.

    Args:
        result: of the photo.
        index: of the person.
        raster: of the texture.
        darken: whether what is guessed is darker.
    """
    body = dressed_bodies(result).people[index]
    faces = np.asarray(result.faces, np.int64)
    guess = (
        _shaded_skin(body.guessed_colors, body.normals, result) if darken else body.guessed_colors
    )
    colors = []
    filled = []
    values = np.concatenate([body.vertices, body.photo_weight[:, None], guess], 1)
    for part in raster.parts():
        points, weight, beside = np.split(part.interpolate(faces, values), [3, 4], axis=1)
        photo, visible_share, near = photo_colors(result, index, points, weight[:, 0])
        colors.append(_blend_with_photo(photo, near, beside))
        filled.append(np.round(255 * (1 - visible_share)).astype(np.uint8))
    return raster.image(np.concatenate(colors)), raster.image(np.concatenate(filled))


def image_of_vertices(colors: UInt8Array, source: str, size: int) -> UInt8Array:
    """Return colours (V, 3) of the vertices of a body as a texture (size, size, 3)."""
    raster = texture_raster(source, size)
    mesh = texture_coordinates(source)
    texels = raster.interpolate(mesh.vertex[mesh.faces], colors.astype(np.float64))
    return raster.image(np.round(texels).astype(np.uint8))


@lru_cache(maxsize=2)
def texture_coordinates(source: str) -> TextureCoordinates:
    """Return the texture coordinates of a body: "embedded", or the path of an SMPL-X file.

    Raises:
        BodyModelError: the file has none.
    """
    body = embedded_arrays() if source == "embedded" else smplx_arrays(source)
    return load_texture_coordinates(source, body.faces)


@lru_cache(maxsize=len(SIZES))
def texture_raster(source: str, size: int) -> TextureRaster:
    """Return the texels of a body in a texture of ``size`` x ``size``."""
    return rasterize_texture(texture_coordinates(source), size)


def _sides_and_parts(model: BodyArrays | None, count: int) -> tuple[Int64Array, Int64Array]:
    """Return the vertex (V,) on the other side of the body, and the part (V,) of each.

    Without a body model, each vertex is its own other side, and all are one part.
    """
    from scipy.spatial import cKDTree

    if model is None:
        return np.arange(count), np.zeros(count, np.int64)
    rest = model.template.astype(np.float64)
    return cKDTree(rest).query(rest * [-1.0, 1.0, 1.0])[1], model.part_of_vertex


def _laplacian(faces: Int64Array, count: int) -> csr_matrix:
    """Return the graph Laplacian (count, count) of the edges of a mesh."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import laplacian

    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    links = coo_matrix((np.ones(len(edges)), tuple(edges.T)), (count, count)).tocsr()
    return laplacian(((links + links.T) > 0).astype(np.float64))


def _fill(
    photo: Float64Array,
    weight: Float64Array,
    laplacian: csr_matrix,
    others: Int64Array,
    parts: Int64Array,
) -> Float64Array:
    """Return a colour (V, 3) of each vertex: the photo's, the other side's, and smooth between.

    It minimises ``sum w (c - photo)^2 + sum over edges (c_i - c_j)^2 + PART_WEIGHT (c - mean of the
    part)^2`` over the vertices that the photo does not fully show.
    """
    import scipy.sparse as sp
    from scipy.sparse.linalg import splu

    count = len(photo)
    if not (weight > 0).any():
        return np.tile(np.array(BODY_RGB, np.float64), (count, 1))
    from_other = (weight < MIRROR_WEIGHT) & (weight[others] > MIRROR_WEIGHT)
    target = np.where(from_other[:, None], photo[others], photo)
    trust = np.where(from_other, MIRROR_WEIGHT * weight[others], weight)
    size = int(parts.max()) + 1
    amount = np.bincount(parts, trust, size)
    mean = (trust[:, None] * target).sum(0) / trust.sum()
    of_part = np.stack([np.bincount(parts, trust * column, size) for column in target.T], 1)
    of_part = (of_part + 1e-3 * mean) / (amount + 1e-3)[:, None]
    free = np.flatnonzero(weight < 1)
    solved = np.where(weight[:, None] < 1, 0.0, photo)
    right = 10 * trust[:, None] * target + PART_WEIGHT * of_part[parts] - laplacian @ solved
    system = (sp.diags(10 * trust + PART_WEIGHT) + laplacian)[free][:, free].tocsc()
    # As for any symmetric matrix: other orders take twice as long.
    factors = splu(system, "MMD_AT_PLUS_A", 0.0, options={"SymmetricMode": True})
    solved[free] = factors.solve(right[free])
    return solved


def _blend_with_photo(
    photo: Float64Array, weight: Float64Array, beside: Float64Array
) -> UInt8Array:
    """Return the colours of the photo by their weight (n,), and others for the rest."""
    blend = np.minimum(weight, 1)[:, None]
    return np.clip(np.round(blend * photo + (1 - blend) * beside), 0, 255).astype(np.uint8)


def _shaded_skin(
    colors: Float64Array, normals: Float64Array, result: Reconstruction
) -> Float64Array:
    """Return guessed colours (V, 3) of skin with normals (V, 3) under a light from above and the
    left.
    """
    up = np.asarray(up_in_camera(result.scene.level), np.float64)
    light = 0.8 * up - [0.6, 0.0, 0.0]
    light = light / np.linalg.norm(light)
    return colors * (_DARK + (_LIGHT - _DARK) * (0.5 + 0.5 * normals @ light))[:, None]


def _texture_size(result: Reconstruction, index: int) -> int:
    """Return the size of the texture of a person."""
    rows = np.flatnonzero(result.people[index].mask.any(1))
    tallest = np.ptp(rows) + 1 if len(rows) else 0
    return next((size for size in SIZES if size >= tallest), SIZES[-1])
