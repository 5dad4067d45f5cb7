"""What a camera sees of a mesh: depth, normals, ids, and a shaded picture with soft shadows.

Camera frame (OpenCV), metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from physic_core.testing.casting import Caster, Hits

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from physic_core.types import FloatArray, Intrinsics, UInt8Array

__all__ = ["Mesh", "View", "photograph", "pixel_rays", "view"]

_AMBIENT, _LAMP, _FILL = 0.30, 0.52, 0.10
_LAMP_RADIUS = 0.35  # m; each sub-pixel sees its own point of the lamp, which softens the shadows


@dataclass(frozen=True)
class Mesh:
    """Triangles of one or more things.

    Attributes:
        vertices: (V, 3) metres.
        faces: (F, 3) int64, counter-clockwise seen from outside.
        thing: (F,) int64, which thing each face belongs to: -1 the scene, else the person's number.
        smooth: (V, 3) unit normals for shading; zero where the face's own normal is to be used.
    """

    vertices: FloatArray
    faces: NDArray[np.int64]
    thing: NDArray[np.int64]
    smooth: FloatArray

    @cached_property
    def flat(self) -> FloatArray:
        """(F, 3) unit normals of the faces, out of the thing."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        unit: FloatArray = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        return unit


@dataclass(frozen=True)
class View:
    """One ray through each pixel centre.

    Attributes:
        depth: (H, W) float64 metres along z, inf where nothing is seen.
        normals: (H, W, 3) unit, of the faces, towards the camera; zero where nothing is seen.
        face: (H, W) int64, -1 where nothing is seen.
    """

    depth: FloatArray
    normals: FloatArray
    face: NDArray[np.int64]


def pixel_rays(intrinsics: Intrinsics, shift: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
    """Rays (H * W, 3) with z = 1 through pixel centres moved by ``shift`` px."""
    v, u = np.mgrid[: intrinsics.height, : intrinsics.width]
    x = (u.reshape(-1) + shift[0] - intrinsics.cx) / intrinsics.fx
    y = (v.reshape(-1) + shift[1] - intrinsics.cy) / intrinsics.fy
    return np.stack([x, y, np.ones_like(x)], axis=1)


def view(mesh: Mesh, caster: Caster, intrinsics: Intrinsics) -> View:
    """Cast one ray a pixel."""
    rays = pixel_rays(intrinsics)
    hits = caster.first(np.zeros(3), rays)
    shape = (intrinsics.height, intrinsics.width)
    return View(
        depth=hits.distance.reshape(shape),
        normals=_face_normals(mesh, hits, rays).reshape(*shape, 3),
        face=hits.face.reshape(shape),
    )


def photograph(
    mesh: Mesh,
    caster: Caster,
    intrinsics: Intrinsics,
    lamp: FloatArray,
    albedo: Callable[[Hits, FloatArray], FloatArray],
    noise: FloatArray,
) -> UInt8Array:
    """A shaded picture, four rays a pixel.

    Args:
        mesh: what is seen.
        caster: of the mesh.
        intrinsics: the camera's.
        lamp: (3,) middle of the lamp, metres.
        albedo: hits and their points (n, 3) -> (n, 3) colours in [0, 1].
        noise: (H, W, 3) grey levels that the sensor adds.

    Returns:
        (H, W, 3) uint8 RGB.
    """
    light = np.zeros((intrinsics.height * intrinsics.width, 3))
    for k, shift in enumerate(((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))):
        rays = pixel_rays(intrinsics, shift)
        hits = caster.first(np.zeros(3), rays)
        seen = hits.face >= 0
        points = rays * np.where(seen, hits.distance, 1.0)[:, None]
        flat = _face_normals(mesh, hits, rays)
        normals = _shading_normals(mesh, hits, flat)
        angle = np.pi * (k + 0.5) / 2
        source = lamp + _LAMP_RADIUS * np.array([np.cos(angle), 0.0, np.sin(angle)])
        away = source - points
        distance = np.linalg.norm(away, axis=1)
        # Lifted off the surface, so that a face does not shade itself.
        dark = caster.blocked(points + 2e-3 * flat, away - 2e-3 * flat)
        cosine = np.clip(np.einsum("ij,ij->i", normals, away) / distance, 0, None)
        head_on = np.clip(-np.einsum("ij,ij->i", normals, rays) / np.linalg.norm(rays, axis=1), 0, None)
        strength = _AMBIENT + _FILL * head_on + _LAMP * np.where(dark, 0, cosine) * np.clip(6 / distance**2, 0, 1.6)
        light += np.where(seen[:, None], albedo(hits, points) * strength[:, None], 0.0)
    picture = 255 * np.clip(light / 4, 0, 1) ** (1 / 2.2)
    picture = picture.reshape(intrinsics.height, intrinsics.width, 3) + noise
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)


def _face_normals(mesh: Mesh, hits: Hits, rays: FloatArray) -> FloatArray:
    """(n, 3) unit, turned towards where the ray comes from; zero where nothing is hit."""
    normals = mesh.flat[np.maximum(hits.face, 0)]
    towards = np.where(np.einsum("ij,ij->i", normals, rays)[:, None] > 0, -normals, normals)
    return np.where((hits.face >= 0)[:, None], towards, 0.0)


def _shading_normals(mesh: Mesh, hits: Hits, flat: FloatArray) -> FloatArray:
    corner_normals = mesh.smooth[mesh.faces[np.maximum(hits.face, 0)]]
    blended = np.einsum("ijk,ij->ik", corner_normals, hits.corners)
    length = np.linalg.norm(blended, axis=1, keepdims=True)
    return np.where(length > 1e-6, blended / np.maximum(length, 1e-6), flat)
