"""Rendering of a mesh: depth, normals, face ids, and a shaded image with soft shadows.

Camera frame (OpenCV), metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from physic_core.geometry.rays import RayCaster, RayHits
from physic_testing.worlds.reproducible_math import apply, dot

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from physic_core.types import FloatArray, Intrinsics, UInt8Array

__all__ = [
    "AreaLight",
    "Lighting",
    "RenderedView",
    "WorldMesh",
    "exposure_gain",
    "pixel_rays",
    "render_shaded",
    "render_view",
    "to_srgb",
]

_SHIFTS = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))
_AMBIENT_RANGE = 0.7  # m; what is nearer than this darkens the light that comes from everywhere
_BRIGHTNESS = 0.25  # linear mean of an exposed picture, about 136 of 255 grey levels


@dataclass(frozen=True)
class WorldMesh:
    """Triangle mesh of the scene and its people.

    Attributes:
        vertices: (V, 3) metres.
        faces: (F, 3) int64, counter-clockwise from outside.
        thing: (F,) int64, index of each face's person, -1 for the scene.
        smooth: (V, 3) unit normals for smooth shading; zero for flat shading.
    """

    vertices: FloatArray
    faces: NDArray[np.int64]
    thing: NDArray[np.int64]
    smooth: FloatArray

    @cached_property
    def face_normals(self) -> FloatArray:
        """Outward unit normals (F, 3) of the faces."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        unit: FloatArray = normals / np.maximum(
            np.linalg.norm(normals, axis=1, keepdims=True), 1e-12
        )
        return unit


@dataclass(frozen=True)
class RenderedView:
    """Depth, normals and face ids at the pixel centres.

    Attributes:
        depth: (H, W) float64 metres along z, inf without a hit.
        normals: (H, W, 3) unit face normals towards the camera; zero without a hit.
        face: (H, W) int64, -1 without a hit.
    """

    depth: FloatArray
    normals: FloatArray
    face: NDArray[np.int64]


@dataclass(frozen=True)
class AreaLight:
    """A disc-shaped light.

    Attributes:
        position: (3,) metres, camera frame; far away for the sun.
        radius: metres; a larger radius gives softer shadows.
        power: irradiance at one metre, or everywhere if ``distant``.
        colour: (3,) RGB factor.
        distant: whether the irradiance does not depend on the distance.
    """

    position: FloatArray
    radius: float
    power: float
    colour: FloatArray
    distant: bool = False


@dataclass(frozen=True)
class Lighting:
    """All lights of a scene.

    Attributes:
        lamps: lights with shadows.
        ambient: ambient light, reduced near occluders.
        fill: light from the camera's direction, without shadows.
    """

    lamps: tuple[AreaLight, ...]
    ambient: float
    fill: float


def pixel_rays(intrinsics: Intrinsics, shift: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
    """Return rays (H * W, 3) with z = 1 through the pixel centres, shifted by ``shift`` px."""
    v, u = np.mgrid[: intrinsics.height, : intrinsics.width]
    x = (u.reshape(-1) + shift[0] - intrinsics.cx) / intrinsics.fx
    y = (v.reshape(-1) + shift[1] - intrinsics.cy) / intrinsics.fy
    return np.stack([x, y, np.ones_like(x)], axis=1)


def render_view(mesh: WorldMesh, caster: RayCaster, intrinsics: Intrinsics) -> RenderedView:
    """Render depth, normals and face ids with one ray per pixel."""
    rays = pixel_rays(intrinsics)
    hits = caster.first(np.zeros(3), rays)
    shape = (intrinsics.height, intrinsics.width)
    return RenderedView(
        depth=hits.distance.reshape(shape),
        normals=_face_normals(mesh, hits, rays).reshape(*shape, 3),
        face=hits.face.reshape(shape),
    )


def render_shaded(
    mesh: WorldMesh,
    caster: RayCaster,
    intrinsics: Intrinsics,
    seen: RenderedView,
    lighting: Lighting,
    albedo: Callable[[RayHits, FloatArray, FloatArray], FloatArray],
    sky: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """Render a shaded image in linear light with four rays per pixel.

    Args:
        mesh: rendered mesh.
        caster: ray caster of the mesh.
        intrinsics: camera intrinsics.
        seen: view of the same mesh with the same camera.
        lighting: lights of the scene.
        albedo: hits, points (n, 3) and pixel footprint (n,) in metres -> colours (n, 3) in [0, 1].
        sky: rays (n, 3) without a hit -> light (n, 3).

    Returns:
        (H, W, 3), before exposure.
    """
    openness = _ambient_visibility(caster, intrinsics, seen).reshape(-1)
    light = np.zeros((intrinsics.height * intrinsics.width, 3))
    for k, shift in enumerate(_SHIFTS):
        all_rays = pixel_rays(intrinsics, shift)
        hits = caster.first(np.zeros(3), all_rays)
        there = hits.face >= 0
        if not there.all():
            light[~there] += sky(all_rays[~there])
        hits = RayHits(hits.face[there], hits.distance[there], hits.corners[there])
        rays = all_rays[there]
        points = rays * hits.distance[:, None]
        flat = _face_normals(mesh, hits, rays)
        normals = _shading_normals(mesh, hits, flat)
        length = np.linalg.norm(rays, axis=1)
        head_on = np.clip(-dot(normals, rays) / length, 0, None)
        strength = np.repeat(
            (lighting.ambient * openness[there] + lighting.fill * head_on)[:, None], 3, axis=1
        )
        for lamp in lighting.lamps:
            strength += (
                _light_from(caster, points, flat, normals, lamp, np.pi * (k + 0.5) / 2)[:, None]
                * lamp.colour
            )
        # Seen at a slant a pixel covers more, but not along the whole slant.
        blur = hits.distance / intrinsics.fx / np.maximum(np.sqrt(head_on), 0.15)
        light[there] += albedo(hits, points, blur) * strength
    return (light / len(_SHIFTS)).reshape(intrinsics.height, intrinsics.width, 3)


def to_srgb(light: FloatArray, gain: float, noise: FloatArray) -> UInt8Array:
    """Convert linear light (H, W, 3) times ``gain`` to 8-bit sRGB, with highlight compression and
    sensor noise.
    """
    bright = gain * light
    shown = np.where(
        bright < 0.7, bright, 0.7 + 0.3 * (1 - np.exp(-(np.maximum(bright, 0.7) - 0.7) / 0.3))
    )
    picture = 255 * np.clip(shown, 0, 1) ** (1 / 2.2) + noise
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)


def exposure_gain(light: FloatArray) -> float:
    """Return the gain that gives an image of medium brightness."""
    return _BRIGHTNESS / float(np.minimum(light, np.quantile(light, 0.95)).mean())


def _light_from(
    caster: RayCaster,
    points: FloatArray,
    flat: FloatArray,
    normals: FloatArray,
    lamp: AreaLight,
    angle: float,
) -> FloatArray:
    """Return the light (n,) of a lamp at points; each sub-pixel samples another point of the
    lamp.
    """
    source = lamp.position + lamp.radius * np.array([np.cos(angle), 0.0, np.sin(angle)])
    away = source - points
    distance = np.linalg.norm(away, axis=1)
    cosine = dot(normals, away) / distance
    facing = (cosine > 0) & (dot(flat, away) > 0)
    # Lifted off the surface, so that a face does not shade itself.
    facing[facing] = ~caster.blocked((points + 2e-3 * flat)[facing], (away - 2e-3 * flat)[facing])
    falloff = 1.0 if lamp.distant else np.minimum(1 / distance**2, 1.0)
    return np.where(facing, cosine * lamp.power * falloff, 0.0)


def _ambient_visibility(
    caster: RayCaster, intrinsics: Intrinsics, seen: RenderedView
) -> FloatArray:
    """Return the unoccluded share (H, W) of the hemisphere above each pixel's surface, smoothed."""
    height, width = seen.face.shape
    normals = seen.normals.reshape(-1, 3)
    there = seen.face.reshape(-1) >= 0
    depth = np.where(there, seen.depth.reshape(-1), 1.0)
    points = pixel_rays(intrinsics) * depth[:, None] + 2e-3 * normals
    # Each pixel of a block of 4 x 4 looks into four directions of its own; the block together
    # covers the hemisphere.
    spiral = np.arange(64)
    z = np.sqrt(1 - (spiral + 0.5) / 64)  # cosine-weighted
    turn = spiral * np.pi * (3 - np.sqrt(5))
    sphere = np.stack(
        [np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1
    )
    v, u = np.mgrid[:height, :width]
    block = ((u % 4) + 4 * (v % 4)).reshape(-1)
    side = np.where(np.abs(normals[:, :1]) < 0.8, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    tangent = np.cross(normals, side)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-9)
    other = np.cross(normals, tangent)
    free = np.zeros(len(points))
    for k in range(4):
        local = sphere[(block * 7 % 16) + 16 * k]
        direction = local[:, :1] * tangent + local[:, 1:2] * other + local[:, 2:] * normals
        free[there] += ~caster.blocked(points[there], _AMBIENT_RANGE * direction[there])
    return _smoothed((free / 4).reshape(height, width), seen)


def _smoothed(values: FloatArray, seen: RenderedView) -> FloatArray:
    """Average over 4 x 4 px, only over pixels of similar depth and normal."""
    total = np.zeros(values.shape)
    weight = np.full(values.shape, 1e-9)
    padded = [
        np.pad(x, ((2, 2), (2, 2), *([(0, 0)] * (x.ndim - 2))), "edge")
        for x in (values, seen.depth, seen.normals)
    ]
    height, width = values.shape
    depth = np.where(np.isfinite(seen.depth), seen.depth, 0.0)
    for i in range(4):
        for j in range(4):
            value, far, normal = (x[i : i + height, j : j + width] for x in padded)
            far = np.where(np.isfinite(far), far, -1.0)
            like = (np.abs(far - depth) < 0.03 * depth) & (dot(normal, seen.normals) > 0.8)
            total += value * like
            weight += like
    return np.where(weight > 0.5, total / weight, values)


def _face_normals(mesh: WorldMesh, hits: RayHits, rays: FloatArray) -> FloatArray:
    """Return unit face normals (n, 3) towards the ray origin; zero without a hit."""
    normals = mesh.face_normals[np.maximum(hits.face, 0)]
    towards = np.where(dot(normals, rays)[:, None] > 0, -normals, normals)
    return np.where((hits.face >= 0)[:, None], towards, 0.0)


def _shading_normals(mesh: WorldMesh, hits: RayHits, flat: FloatArray) -> FloatArray:
    """Interpolate the vertex normals at the hits; use the face normals where they are zero."""
    corner_normals = mesh.smooth[mesh.faces[np.maximum(hits.face, 0)]]
    blended = apply(np.swapaxes(corner_normals, 1, 2), hits.corners)
    length = np.linalg.norm(blended, axis=1, keepdims=True)
    return np.where(length > 1e-6, blended / np.maximum(length, 1e-6), flat)
