"""Seeded random errors of the mocks.

The random numbers depend only on the world, the noise seed and the purpose, and their scale only on
the options: twice the noise gives twice the same error.
"""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray
    from physic_testing.worlds import World

REFERENCE_WIDTH_PX = 640
"""Longer image side for which options in px are defined; they scale with the image."""


def seeded_rng(
    world: World, noise_seed: int, purpose: str, *, all_views: bool = False
) -> np.random.Generator:
    """Return a random generator that depends only on the world, the noise seed and the purpose.

    Views of one moment have errors of their own, but for what every photo of a person shows alike
    (``all_views``).
    """
    name = world.name.partition("_view")[0] if all_views else world.name
    return np.random.default_rng([noise_seed, zlib.crc32(f"{name} {purpose}".encode())])


def scale_to_image(stated_px: float, shape: tuple[int, int]) -> float:
    """Scale a length from an image REFERENCE_WIDTH_PX wide to an image of shape (H, W), px."""
    return stated_px * max(shape) / REFERENCE_WIDTH_PX


def bernoulli(share: float, noise: float, draws: FloatArray) -> BoolArray:
    """Return which uniform draws (...) are below ``share`` times ``noise``."""
    happens: BoolArray = draws < min(1.0, share * noise)
    return happens


def smooth_image(shape: tuple[int, int], waves: float, rng: np.random.Generator) -> FloatArray:
    """Return a random smooth image (H, W) of unit variance with about ``waves`` waves on the longer
    side.
    """
    v, u = np.mgrid[: shape[0], : shape[1]] / max(shape)
    return smooth_field(np.stack([u, v], axis=-1), 1 / waves, rng)


def smooth_field(
    points: FloatArray, wavelength: float, rng: np.random.Generator, terms: int = 12
) -> FloatArray:
    """Return a random smooth function of points (..., D), unit variance, about one wave per
    ``wavelength``.
    """
    directions = rng.normal(size=(terms, points.shape[-1]))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lengths = 2 * np.pi / (wavelength * rng.uniform(0.7, 1.6, terms))
    phases = rng.uniform(0, 2 * np.pi, terms)
    total = np.zeros(points.shape[:-1])
    for direction, length, phase in zip(directions, lengths, phases, strict=True):
        total += np.cos(points @ direction * length + phase)
    field: FloatArray = total * np.sqrt(2 / terms)
    return field


def roughen_border(mask: BoolArray, amount_px: float, rng: np.random.Generator) -> BoolArray:
    """Return the mask (H, W) with its border shifted by about ``amount_px``, in waves of about 12
    px.
    """
    import cv2

    stray = smooth_image(mask.shape, REFERENCE_WIDTH_PX / 12, rng)
    if amount_px == 0:
        return mask.copy()
    inside = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)
    outside = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
    moved: BoolArray = inside - outside + amount_px * stray > 0
    return moved


def add_rotation_noise(rotvecs: FloatArray, degrees: float, rng: np.random.Generator) -> FloatArray:
    """Compose rotation vectors (..., 3) with random rotations of ``degrees`` standard deviation per
    axis.
    """
    from scipy.spatial.transform import Rotation

    flat = rotvecs.reshape(-1, 3).astype(np.float64)
    error = Rotation.from_rotvec(np.radians(degrees) * rng.normal(size=flat.shape))
    result: FloatArray = (
        (Rotation.from_rotvec(flat) * error).as_rotvec().reshape(rotvecs.shape).astype(np.float32)
    )
    return result
