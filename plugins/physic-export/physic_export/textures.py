"""Textures of bodies with the colours of the photo.

A texel that the photo shows has the photo's colour; the weight falls where the surface turns away from the camera. The
rest is filled: with the other side of the body where the photo shows that, and over the surface between, towards the
mean of the body part. Of several photos, each texel has the colour of the photo with the largest weight there.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import load_body
from physic_core.errors import InputError
from physic_core.geometry.mesh import vertex_normals
from physic_core.geometry.rays import RayCaster
from physic_core.types import CameraView
from physic_core.visual.palette import BODY_RGB, contact_colors
from physic_core.visual.rig import body_of_result
from physic_export.texture_coordinates import TextureCoordinates, load_texture_coordinates
from physic_export.texture_raster import TextureRaster, pad_texture, rasterize

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core import ExportRequest
    from physic_core.body.model import BodyModel
    from physic_core.types import Reconstruction, UInt8Array

    Array = NDArray[np.float64]

FULL_FACING, NO_FACING = 0.45, 0.15
"""Cosines between surface normal and the ray to the camera, from which the photo counts fully, and below which not."""

RIM_SHARE = 0.006
"""Width of a mask's rim, whose colours mix with the background, as a share of the person's height in px."""

REACH_SHARE = 0.04
"""Distance to the mask, as a share of the person's height, up to which a body that is not quite under it is filled with
the nearest colour of the mask."""

HIDDEN_M = 0.015
"""A texel is hidden by a body that is nearer than it by more than this, metres."""

MIRROR_WEIGHT, NEAREST_WEIGHT, PART_WEIGHT = 0.3, 0.3, 0.002
"""Weights of the other side, of the nearest colour of the mask and of the part's mean against what the photo shows."""


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
    bodies = [person.vertices for person in result.people if np.isfinite(person.vertices).all()]
    faces = np.asarray(result.faces, np.int64)
    every = np.concatenate([faces + number * len(bodies[0]) for number in range(len(bodies))]) if bodies else faces
    caster = RayCaster(np.concatenate(bodies), every) if bodies else None
    textures = {index: _texture(result, index, model, raster, caster) for index, _ in request.chosen() if caster}
    return TexturedBodies(mesh, raster, textures)


@lru_cache(maxsize=2)
def _mesh(source: str, size: int) -> tuple[TextureCoordinates, TextureRaster]:
    faces = load_body(source if source == "embedded" else Path(source)).faces.numpy()
    mesh = load_texture_coordinates(source, faces)
    return mesh, rasterize(mesh, size)


def _texture(
    result: Reconstruction, index: int, model: BodyModel, raster: TextureRaster, caster: RayCaster
) -> BodyTexture:
    person = result.people[index]
    faces, vertices = np.asarray(result.faces, np.int64), person.vertices.astype(np.float64)
    points = raster.interpolate(faces, vertices)
    normals = raster.interpolate(faces, vertex_normals(vertices, faces))
    photo = np.zeros((len(points), 3))
    seen, weight = np.zeros((2, len(points)))
    for view in result.cameras or (CameraView.of_reference(result, ""),):
        if index in view.people:
            colors, own, near = _seen_colors(view, view.people[index].mask, points, normals, caster)
            better = near > weight
            photo[better], seen[better], weight[better] = colors[better], own[better], near[better]
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


def _smooth(share: Array) -> Array:
    t = np.clip(share, 0.0, 1.0)
    return t * t * (3 - 2 * t)


def _seen_colors(
    camera: CameraView, mask: NDArray[np.bool_], points: Array, normals: Array, caster: RayCaster
) -> tuple[Array, Array, Array]:
    """Return the colours (n, 3) of a photo at points of a body, and their weights (n,) in the mask and near it."""
    rays, local = points - camera.centre, np.asarray(camera.to_camera(points), np.float64)
    reach = np.linalg.norm(rays, axis=1)
    facing = -(normals * rays).sum(1) / np.maximum(np.linalg.norm(normals, axis=1) * reach, 1e-12)
    weight = _smooth((facing - NO_FACING) / (FULL_FACING - NO_FACING))
    candidate = np.flatnonzero((weight > 0) & (local[:, 2] > 0))
    distance = caster.first(camera.centre, rays[candidate]).distance
    visible = np.zeros(len(points), bool)
    visible[candidate] = distance > 1 - HIDDEN_M / reach[candidate]
    photo, shown, near = _sample(camera, np.asarray(mask, bool), local)
    seen = weight * (visible & shown)
    return photo, seen, np.maximum(seen, NEAREST_WEIGHT * weight * (visible & near))


def _sample(
    camera: CameraView, mask: NDArray[np.bool_], points: Array
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the photo's colours (n, 3) at points of its frame, and whether each is in the mask, and near to it.

    Outside the mask (H, W) the colour is that of the nearest pixel in it.
    """
    import cv2

    if not mask.any():
        none = np.zeros(len(points), bool)
        return np.zeros((len(points), 3)), none, none
    height = float(np.ptp(np.flatnonzero(mask.any(1)))) + 1
    inner = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    core = inner > min(RIM_SHARE * height, 0.5 * inner.max())
    outer = cv2.distanceTransform((~core).astype(np.uint8), cv2.DIST_L2, 5)
    image = pad_texture(camera.image, core)
    pixels = points @ camera.intrinsics.matrix.T
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = (pixels[:, :2] / pixels[:, 2:]).T.astype(np.float32)
    place = (np.nan_to_num(x, nan=-9, posinf=-9, neginf=-9), np.nan_to_num(y, nan=-9, posinf=-9, neginf=-9))
    limit = 32_000  # cv2.remap takes no more rows than this
    parts = [slice(start, start + limit) for start in range(0, len(points), limit)]

    def at(picture: NDArray[np.float32], outside: float) -> NDArray[np.float32]:
        rows = [
            cv2.remap(
                picture,
                place[0][part][:, None],
                place[1][part][:, None],
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_CONSTANT,
                borderValue=(outside,) * 3,
            ).reshape(len(place[0][part]), -1)
            for part in parts
        ]
        return np.concatenate(rows)

    far = at(outer.astype(np.float32), 1e6)[:, 0]
    colors = at(image.astype(np.float32), 0.0)
    return colors.astype(np.float64), far < 0.5, far < REACH_SHARE * height


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


def encode_jpeg(image: UInt8Array) -> bytes:
    """Return an image as JPEG."""
    return _encode(image, "JPEG", quality=90)


def encode_png(image: UInt8Array) -> bytes:
    """Return an image as PNG."""
    return _encode(image, "PNG", optimize=True)


def _encode(image: UInt8Array, form: str, **settings: int | bool) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, form, **settings)
    return buffer.getvalue()
