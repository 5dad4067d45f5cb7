"""Seeded errors of the mocks.

Every draw depends on the world, the noise seed and its purpose alone, and its size on the options alone: twice the
noise is twice the same error.
"""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray
    from physic_testing.worlds import World

__all__ = [
    "REFERENCE_WIDTH_PX",
    "chance",
    "generator",
    "pixels_of",
    "ragged",
    "smooth_field",
    "smooth_image",
    "turned",
]

REFERENCE_WIDTH_PX = 640
"""Longer side of the photo in which lengths in px are stated; they grow with the photo."""


def generator(world: World, noise_seed: int, purpose: str) -> np.random.Generator:
    """Random numbers that depend on the world, on the seed and on what they are for, and on nothing else."""
    return np.random.default_rng([noise_seed, world.seed, zlib.crc32(f"{world.name} {purpose}".encode())])


def pixels_of(stated_px: float, shape: tuple[int, int]) -> float:
    """Px in a picture (H, W) of what is ``stated_px`` in one of REFERENCE_WIDTH_PX."""
    return stated_px * max(shape) / REFERENCE_WIDTH_PX


def chance(share: float, noise: float, draws: FloatArray) -> BoolArray:
    """Which of uniform draws (...) come true, of a ``share`` of them times ``noise``."""
    happens: BoolArray = draws < min(1.0, share * noise)
    return happens


def smooth_image(shape: tuple[int, int], waves: float, rng: np.random.Generator) -> FloatArray:
    """A random surface (H, W) of unit variance with about ``waves`` waves across the longer side."""
    v, u = np.mgrid[: shape[0], : shape[1]] / max(shape)
    return smooth_field(np.stack([u, v], axis=-1), 1 / waves, rng)


def smooth_field(points: FloatArray, wavelength: float, rng: np.random.Generator, terms: int = 12) -> FloatArray:
    """A random function of unit variance over space: points (..., D) -> (...), about one wave a ``wavelength``."""
    directions = rng.normal(size=(terms, points.shape[-1]))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lengths = 2 * np.pi / (wavelength * rng.uniform(0.7, 1.6, terms))
    phases = rng.uniform(0, 2 * np.pi, terms)
    total = np.zeros(points.shape[:-1])
    for direction, length, phase in zip(directions, lengths, phases, strict=True):
        total += np.cos(points @ direction * length + phase)
    field: FloatArray = total * np.sqrt(2 / terms)
    return field


def ragged(mask: BoolArray, amount_px: float, rng: np.random.Generator) -> BoolArray:
    """The mask (H, W) with its border moved in and out by about ``amount_px``, in waves some 12 px long."""
    import cv2

    stray = smooth_image(mask.shape, REFERENCE_WIDTH_PX / 12, rng)
    if amount_px == 0:
        return mask.copy()
    inside = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)
    outside = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
    moved: BoolArray = inside - outside + amount_px * stray > 0
    return moved


def turned(rotvecs: FloatArray, degrees: float, rng: np.random.Generator) -> FloatArray:
    """Rotation vectors (..., 3), each followed by a random turn of ``degrees`` standard deviation about each axis."""
    from scipy.spatial.transform import Rotation

    flat = rotvecs.reshape(-1, 3).astype(np.float64)
    error = Rotation.from_rotvec(np.radians(degrees) * rng.normal(size=flat.shape))
    result: FloatArray = (Rotation.from_rotvec(flat) * error).as_rotvec().reshape(rotvecs.shape).astype(np.float32)
    return result
