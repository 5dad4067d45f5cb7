"""Rotations from directions, in numpy and float64: what closed-form fits of a body are made of.

Each takes any leading dimensions; directions need not be of unit length.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

__all__ = ["aligned", "between", "cross", "exp", "log", "nearest_rotation", "parted", "swing", "turned", "unit"]

Array = NDArray[np.float64]

_TINY = 1e-12


def unit(vectors: Array) -> Array:
    """Vectors (..., 3) of length 1; zero where they have no length."""
    length = np.sqrt((vectors * vectors).sum(-1, keepdims=True))
    scaled: Array = vectors / np.maximum(length, _TINY)
    return scaled


def turned(rotations: Array, vectors: Array) -> Array:
    """Rotations (..., 3, 3) applied to vectors (..., 3)."""
    product: Array = (rotations @ vectors[..., None])[..., 0]
    return product


def cross(first: Array, second: Array) -> Array:
    """Vector product (..., 3): numpy's own takes five times as long for a few vectors."""
    a, b, c = first[..., 0], first[..., 1], first[..., 2]
    d, e, f = second[..., 0], second[..., 1], second[..., 2]
    return np.stack([b * f - c * e, c * d - a * f, a * e - b * d], -1)


def exp(rotvecs: Array) -> Array:
    """Rotation vectors (..., 3), radians -> matrices (..., 3, 3)."""
    matrices: Array = Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_matrix().reshape(*rotvecs.shape, 3)
    return matrices


def log(rotations: Array) -> Array:
    """Matrices (..., 3, 3) -> rotation vectors (..., 3), radians, none longer than pi."""
    vectors: Array = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_rotvec().reshape(rotations.shape[:-1])
    return vectors


def between(first: Array, second: Array, share: Array | float) -> Array:
    """The rotation (..., 3, 3) that lies a ``share`` (...) of the shortest way from the first to the second."""
    way = log(np.swapaxes(first, -1, -2) @ second)
    return first @ exp(way * np.asarray(share)[..., None])


def swing(first: Array, second: Array) -> Array:
    """The shortest rotations (..., 3, 3) that turn directions (..., 3) into others; half a turn about any axis if so.

    Two half-turns: about the first direction, then about the one in the middle.
    """
    a, b = unit(first), unit(second)
    middle = a + b
    opposite = (middle * middle).sum(-1, keepdims=True) < _TINY
    if opposite.any():
        aside = cross(a, np.where(np.abs(a[..., :1]) < 0.8, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
        middle = np.where(opposite, aside, middle)
    m = unit(middle)
    # (2 m m^T - 1) (2 a a^T - 1)
    ma = (m * a).sum(-1)[..., None, None]
    outer = 4 * ma * m[..., :, None] * a[..., None, :]
    turn: Array = outer - 2 * m[..., :, None] * m[..., None, :] - 2 * a[..., :, None] * a[..., None, :] + np.eye(3)
    return turn


def aligned(along: Array, beside: Array) -> Array:
    """Right-handed frames (..., 3, 3): column 0 along a direction, column 1 as near to another as it can be."""
    x = unit(along)
    y = unit(beside - (beside * x).sum(-1, keepdims=True) * x)
    return np.stack([x, y, cross(x, y)], -1)


def nearest_rotation(moments: Array) -> Array:
    """The rotations (..., 3, 3) R that maximise trace(R^T M): Kabsch, of ``M = sum w target source^T``."""
    left, _, right = np.linalg.svd(moments)
    # The weakest direction is turned over where the product would be a reflection.
    left[..., :, 2] *= np.sign(np.linalg.det(left @ right))[..., None]
    rotations: Array = left @ right
    return rotations


def parted(rotations: Array, axis: Array) -> tuple[Array, Array]:
    """Rotations (..., 3, 3) as ``swing @ twist``, the twist about an axis (..., 3) that it leaves where it is.

    Returns:
        swing (..., 3, 3), and the angle (...) of the twist, radians in (-pi, pi].
    """
    a = unit(axis)
    tilt = swing(a, turned(rotations, a))
    rest = np.swapaxes(tilt, -1, -2) @ rotations
    # Of a rotation about a: the antisymmetric part is sin(t) a, the trace 1 + 2 cos(t).
    sine = 0.5 * (
        a[..., 0] * (rest[..., 2, 1] - rest[..., 1, 2])
        + a[..., 1] * (rest[..., 0, 2] - rest[..., 2, 0])
        + a[..., 2] * (rest[..., 1, 0] - rest[..., 0, 1])
    )
    cosine = 0.5 * (rest[..., 0, 0] + rest[..., 1, 1] + rest[..., 2, 2] - 1)
    return tilt, np.arctan2(sine, cosine)
