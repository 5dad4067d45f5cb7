"""What a camera sees of a mesh: depth, normals, ids, and a shaded picture with soft shadows.

Camera frame (OpenCV), metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.worlds.arithmetic import apply, dot
from physic_testing.worlds.casting import Caster, Hits

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from physic_core.types import FloatArray, Intrinsics, UInt8Array

__all__ = ["Lamp", "Lighting", "Mesh", "View", "expose", "gain_of", "photograph", "pixel_rays", "view"]

_SHIFTS = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))
_CREVICE = 0.7  # m; what is nearer than this darkens the light that comes from everywhere
_BRIGHTNESS = 0.25  # linear mean of an exposed picture, about 136 of 255 grey levels


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


@dataclass(frozen=True)
class Lamp:
    """A round light.

    Attributes:
        position: (3,) metres, camera frame; of the sun, far away.
        radius: metres; a larger one softens the shadows.
        power: light on a surface that faces it from one metre, or from anywhere if ``distant``.
        colour: (3,) of its light.
        distant: whether its light is the same everywhere.
    """

    position: FloatArray
    radius: float
    power: float
    colour: FloatArray
    distant: bool = False


@dataclass(frozen=True)
class Lighting:
    """All light of a place.

    Attributes:
        lamps: that cast shadows.
        ambient: light from everywhere, less in crevices.
        fill: light from the camera's side.
    """

    lamps: tuple[Lamp, ...]
    ambient: float
    fill: float


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
    seen: View,
    lighting: Lighting,
    albedo: Callable[[Hits, FloatArray, FloatArray], FloatArray],
    sky: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """A shaded picture in linear light, four rays a pixel.

    Args:
        mesh: what is seen.
        caster: of the mesh.
        intrinsics: the camera's.
        seen: the same mesh through the same camera.
        lighting: of the place.
        albedo: hits, their points (n, 3) and the width of a pixel there (n,) metres -> (n, 3) colours in [0, 1].
        sky: rays (n, 3) that hit nothing -> (n, 3) their light.

    Returns:
        (H, W, 3), before exposure.
    """
    openness = _openness(caster, intrinsics, seen).reshape(-1)
    light = np.zeros((intrinsics.height * intrinsics.width, 3))
    for k, shift in enumerate(_SHIFTS):
        all_rays = pixel_rays(intrinsics, shift)
        hits = caster.first(np.zeros(3), all_rays)
        there = hits.face >= 0
        if not there.all():
            light[~there] += sky(all_rays[~there])
        hits, rays = Hits(hits.face[there], hits.distance[there], hits.corners[there]), all_rays[there]
        points = rays * hits.distance[:, None]
        flat = _face_normals(mesh, hits, rays)
        normals = _shading_normals(mesh, hits, flat)
        length = np.linalg.norm(rays, axis=1)
        head_on = np.clip(-dot(normals, rays) / length, 0, None)
        strength = np.repeat((lighting.ambient * openness[there] + lighting.fill * head_on)[:, None], 3, axis=1)
        for lamp in lighting.lamps:
            strength += _lit(caster, points, flat, normals, lamp, np.pi * (k + 0.5) / 2)[:, None] * lamp.colour
        # Seen at a slant a pixel covers more, but not along the whole slant.
        blur = hits.distance / intrinsics.fx / np.maximum(np.sqrt(head_on), 0.15)
        light[there] += albedo(hits, points, blur) * strength
    return (light / len(_SHIFTS)).reshape(intrinsics.height, intrinsics.width, 3)


def expose(light: FloatArray, gain: float, noise: FloatArray) -> UInt8Array:
    """Linear light (H, W, 3) times ``gain``, with a shoulder for what is bright, as 8-bit sRGB with sensor noise."""
    bright = gain * light
    shown = np.where(bright < 0.7, bright, 0.7 + 0.3 * (1 - np.exp(-(np.maximum(bright, 0.7) - 0.7) / 0.3)))
    picture = 255 * np.clip(shown, 0, 1) ** (1 / 2.2) + noise
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)


def gain_of(light: FloatArray) -> float:
    """The gain with which the picture is neither dark nor washed out."""
    return _BRIGHTNESS / float(np.minimum(light, np.quantile(light, 0.95)).mean())


def _lit(
    caster: Caster, points: FloatArray, flat: FloatArray, normals: FloatArray, lamp: Lamp, angle: float
) -> FloatArray:
    """(n,) light of a lamp on points; each sub-pixel sees its own point of the lamp, which softens the shadows."""
    source = lamp.position + lamp.radius * np.array([np.cos(angle), 0.0, np.sin(angle)])
    away = source - points
    distance = np.linalg.norm(away, axis=1)
    cosine = dot(normals, away) / distance
    facing = (cosine > 0) & (dot(flat, away) > 0)
    # Lifted off the surface, so that a face does not shade itself.
    facing[facing] = ~caster.blocked((points + 2e-3 * flat)[facing], (away - 2e-3 * flat)[facing])
    falloff = 1.0 if lamp.distant else np.minimum(1 / distance**2, 1.0)
    return np.where(facing, cosine * lamp.power * falloff, 0.0)


def _openness(caster: Caster, intrinsics: Intrinsics, seen: View) -> FloatArray:
    """(H, W) share of the hemisphere over each pixel's surface that is free of near things, smoothed on the surface."""
    height, width = seen.face.shape
    normals = seen.normals.reshape(-1, 3)
    there = seen.face.reshape(-1) >= 0
    depth = np.where(there, seen.depth.reshape(-1), 1.0)
    points = pixel_rays(intrinsics) * depth[:, None] + 2e-3 * normals
    # Each pixel of a block of 4 x 4 looks into four directions of its own; the block together covers the hemisphere.
    spiral = np.arange(64)
    z = np.sqrt(1 - (spiral + 0.5) / 64)  # cosine-weighted
    turn = spiral * np.pi * (3 - np.sqrt(5))
    sphere = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)
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
        free[there] += ~caster.blocked(points[there], _CREVICE * direction[there])
    return _smoothed((free / 4).reshape(height, width), seen)


def _smoothed(values: FloatArray, seen: View) -> FloatArray:
    """Mean over 4 x 4 px, of pixels of like depth and normal only."""
    total, weight = np.zeros(values.shape), np.full(values.shape, 1e-9)
    padded = [
        np.pad(x, ((2, 2), (2, 2), *([(0, 0)] * (x.ndim - 2))), "edge") for x in (values, seen.depth, seen.normals)
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


def _face_normals(mesh: Mesh, hits: Hits, rays: FloatArray) -> FloatArray:
    """(n, 3) unit, turned towards where the ray comes from; zero where nothing is hit."""
    normals = mesh.flat[np.maximum(hits.face, 0)]
    towards = np.where(dot(normals, rays)[:, None] > 0, -normals, normals)
    return np.where((hits.face >= 0)[:, None], towards, 0.0)


def _shading_normals(mesh: Mesh, hits: Hits, flat: FloatArray) -> FloatArray:
    corner_normals = mesh.smooth[mesh.faces[np.maximum(hits.face, 0)]]
    blended = apply(np.swapaxes(corner_normals, 1, 2), hits.corners)
    length = np.linalg.norm(blended, axis=1, keepdims=True)
    return np.where(length > 1e-6, blended / np.maximum(length, 1e-6), flat)
