"""Rotations: closed forms in NumPy, float64.

Functions take any leading dimensions, and directions need not have unit length.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

if TYPE_CHECKING:
    from physic_core.types import Float64Array, FloatArray


_TINY = 1e-12
# Squared sum of opposite unit vectors: below, rounding errs by more than the half turn does.
_OPPOSITE = 1e-16


def unit(vectors: Float64Array) -> Float64Array:
    """Normalize vectors (..., 3) to length 1; a zero vector stays zero."""
    length = np.sqrt((vectors * vectors).sum(-1, keepdims=True))
    scaled: Float64Array = vectors / np.maximum(length, _TINY)
    return scaled


def rotate(rotations: Float64Array, vectors: Float64Array) -> Float64Array:
    """Apply rotations (..., 3, 3) to vectors (..., 3)."""
    return (rotations @ vectors[..., None])[..., 0]


def cross(first: Float64Array, second: Float64Array) -> Float64Array:
    """Return the cross product (..., 3).

    ``np.cross`` takes five times as long for a few vectors.
    """
    a = first[..., 0]
    b = first[..., 1]
    c = first[..., 2]
    d = second[..., 0]
    e = second[..., 1]
    f = second[..., 2]
    return np.stack([b * f - c * e, c * d - a * f, a * e - b * d], -1)


def rotvec_to_rotmat_numpy(rotvecs: Float64Array) -> Float64Array:
    """Convert rotation vectors (..., 3) in radians to matrices (..., 3, 3)."""
    matrices: Float64Array = (
        Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_matrix().reshape(*rotvecs.shape, 3)
    )
    return matrices


def rotmat_to_rotvec(rotations: Float64Array) -> Float64Array:
    """Convert rotation matrices (..., 3, 3) to vectors (..., 3) in radians, of length at most pi.

    Matrices that are not finite give NaN.
    """
    matrices = rotations.reshape(-1, 3, 3)
    finite = np.isfinite(matrices).all(axis=(1, 2))
    vectors = np.full((len(matrices), 3), np.nan)
    vectors[finite] = Rotation.from_matrix(matrices[finite]).as_rotvec()
    return vectors.reshape(rotations.shape[:-1])


_NOT_ORTHONORMAL = 0.05  # largest entry of R R' less the unit matrix


def check_rotations(matrices: FloatArray) -> None:
    """Raise ValueError unless matrices (..., 3, 3) are rotations.

    Raises:
        ValueError: one is not orthonormal, or mirrors.
    """
    off = float(np.abs(matrices @ np.swapaxes(matrices, -1, -2) - np.eye(3)).max(initial=0.0))
    if not off < _NOT_ORTHONORMAL or not (np.linalg.det(matrices) > 0).all():
        raise ValueError(
            f"matrices are no rotations: R R' differs from the unit matrix by up to {off:.2g}, or "
            f"R mirrors; are they scaled, or other than rotation matrices?"
        )


def rotmat_to_quat(rotations: FloatArray) -> Float64Array:
    """Convert rotation matrices (..., 3, 3) to unit quaternions (..., 4): x, y, z, w."""
    quaternions: Float64Array = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_quat()
    return quaternions.reshape(*rotations.shape[:-2], 4)


def rotmat_to_euler(axes: str, rotations: FloatArray) -> Float64Array:
    """Convert rotation matrices (..., 3, 3) to angles (..., 3) in radians.

    Where the first and the third axis coincide, the third angle is 0.

    Args:
        axes: of the three turns in their order: "xyz" are fixed axes, "XYZ" those of the turned
            body.
        rotations: (..., 3, 3).
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Gimbal lock", UserWarning)
        angles: Float64Array = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_euler(axes)
    return angles.reshape(*rotations.shape[:-2], 3)


def slerp(first: Float64Array, second: Float64Array, share: Float64Array | float) -> Float64Array:
    """Interpolate rotations (..., 3, 3) along the shortest arc; share 0 is the first, 1 the second.

    Args:
        first: (..., 3, 3).
        second: (..., 3, 3).
        share: (...) of the arc.
    """
    way = rotmat_to_rotvec(np.swapaxes(first, -1, -2) @ second)
    return first @ rotvec_to_rotmat_numpy(way * np.asarray(share)[..., None])


def rotation_between(first: Float64Array, second: Float64Array) -> Float64Array:
    """Return the smallest rotations (..., 3, 3) from the first directions (..., 3) to the second.

    Opposite directions give half a turn about any perpendicular axis. The rotation is the product
    of two half-turns: about the first direction, then about the bisector.
    """
    a = unit(first)
    b = unit(second)
    middle = a + b
    opposite = (middle * middle).sum(-1, keepdims=True) < _OPPOSITE
    if opposite.any():
        aside = cross(a, np.where(np.abs(a[..., :1]) < 0.8, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
        middle = np.where(opposite, aside, middle)
    m = unit(middle)
    # (2 m m^T - 1) (2 a a^T - 1)
    ma = (m * a).sum(-1)[..., None, None]
    outer = 4 * ma * m[..., :, None] * a[..., None, :]
    turn: Float64Array = (
        outer
        - 2 * m[..., :, None] * m[..., None, :]
        - 2 * a[..., :, None] * a[..., None, :]
        + np.eye(3)
    )
    return turn


def frame_from_axes(along: Float64Array, beside: Float64Array) -> Float64Array:
    """Return right-handed orthonormal frames (..., 3, 3) by Gram-Schmidt.

    Column 0 points along the first direction, column 1 along the part of the second that is
    perpendicular to it.
    """
    x = unit(along)
    y = unit(beside - (beside * x).sum(-1, keepdims=True) * x)
    return np.stack([x, y, cross(x, y)], -1)


def nearest_rotation(moments: Float64Array) -> Float64Array:
    """Return the rotations R (..., 3, 3) that maximise trace(R^T M), M = sum w target source^T
    (Kabsch 1976).
    """
    left, _, right = np.linalg.svd(moments)
    # Flip the direction of the smallest singular value if the product is a reflection.
    left[..., :, 2] *= np.sign(np.linalg.det(left @ right))[..., None]
    rotations: Float64Array = left @ right
    return rotations


def swing_twist(rotations: Float64Array, axis: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Decompose rotations (..., 3, 3) into ``swing @ twist``, with the twist about ``axis`` (...,
    3).

    Returns:
        The swing (..., 3, 3), whose own axis is perpendicular to ``axis``, and the angle (...) of
        the twist in radians in (-pi, pi].
    """
    a = unit(axis)
    tilt = rotation_between(a, rotate(rotations, a))
    rest = np.swapaxes(tilt, -1, -2) @ rotations
    # Of a rotation about a: the antisymmetric part is sin(t) a, the trace 1 + 2 cos(t).
    sine = 0.5 * (
        a[..., 0] * (rest[..., 2, 1] - rest[..., 1, 2])
        + a[..., 1] * (rest[..., 0, 2] - rest[..., 2, 0])
        + a[..., 2] * (rest[..., 1, 0] - rest[..., 0, 1])
    )
    cosine = 0.5 * (rest[..., 0, 0] + rest[..., 1, 1] + rest[..., 2, 2] - 1)
    return tilt, np.arctan2(sine, cosine)
