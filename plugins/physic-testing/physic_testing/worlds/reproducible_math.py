"""Vector and rotation functions with bit-identical results on every CPU and number of threads.

BLAS, ``einsum`` and sines of arrays differ in the last bit between kernels, and decisions of a
world amplify one bit to centimetres. All functions here use only sums, products, quotients and
square roots in a fixed order, whose rounding IEEE 754 defines.
"""

from __future__ import annotations

from math import factorial
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import FloatArray

__all__ = [
    "apply",
    "arctan2",
    "dot",
    "matmul",
    "norm",
    "rotation_matrix",
    "round_to_grid",
    "sin_cos",
]

_GRID = float(1 << 30)
"""Grid steps per metre or radian, about a nanometre each."""

_QUARTER_TURN = (1.5707963267341256, 6.077100506506192e-11)
"""pi / 2 as a sum of two numbers; multiples of the first are exact."""

_TERMS = 18
_ORDER = range(_TERMS - 1, -1, -1)
# Of sin(t) / t and (1 - cos(t)) / t^2, as series in t^2.
_SERIES: NDArray[np.float64] = np.array(
    [[(-1) ** k / factorial(2 * k + 1), (-1) ** k / factorial(2 * k + 2)] for k in range(_TERMS)]
)


def round_to_grid(values: FloatArray | float) -> FloatArray:
    """Round values to multiples of 2^-30.

    The C library's sines and powers may differ in the last bit between machines; rounded values do
    not.
    """
    rounded: FloatArray = np.round(np.asarray(values, np.float64) * _GRID) / _GRID
    return rounded


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the dot products (...) of vectors (..., 3)."""
    product: FloatArray = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
    return product


def norm(vectors: FloatArray) -> FloatArray:
    """Return the lengths (...) of vectors (..., 3)."""
    length: FloatArray = np.sqrt(dot(vectors, vectors))
    return length


def apply(matrix: FloatArray, vectors: FloatArray) -> FloatArray:
    """Multiply matrices (..., 3, 3) by vectors (..., 3)."""
    product: FloatArray = (
        matrix[..., :, 0] * vectors[..., 0, None]
        + matrix[..., :, 1] * vectors[..., 1, None]
        + matrix[..., :, 2] * vectors[..., 2, None]
    )
    return product


def matmul(a: FloatArray, b: FloatArray) -> FloatArray:
    """Multiply matrices (..., i, 3) by matrices (..., 3, j)."""
    product: FloatArray = (
        a[..., :, 0, None] * b[..., None, 0, :]
        + a[..., :, 1, None] * b[..., None, 1, :]
        + a[..., :, 2, None] * b[..., None, 2, :]
    )
    return product


def sin_cos(angle: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """Return sine and cosine of angles of a few turns at most, radians, with an error of 1e-15."""
    angle = np.asarray(angle, np.float64)
    quarter = np.round(angle / _QUARTER_TURN[0])
    rest = angle - quarter * _QUARTER_TURN[0] - quarter * _QUARTER_TURN[1]
    square = rest * rest
    a, b = _series(square)
    sine = rest * a
    cosine = 1 - square * b
    turn = np.mod(quarter, 4)
    choice = [turn == 0, turn == 1, turn == 2]
    return np.select(choice, [sine, cosine, -sine], -cosine), np.select(
        choice, [cosine, -sine, -cosine], sine
    )


def arctan2(y: FloatArray | float, x: FloatArray | float) -> FloatArray:
    """Return the angle of (x, y) from the x axis, radians in [-pi, pi], with an error of 1e-15; 0
    at the origin.
    """
    y = np.asarray(y, np.float64)
    x = np.asarray(x, np.float64)
    # of half the angle from the nearer half axis
    tangent = y / np.maximum(np.sqrt(x * x + y * y) + np.abs(x), 1e-300)
    for _ in range(2):
        tangent = tangent / (1 + np.sqrt(1 + tangent * tangent))
    square = tangent * tangent
    total = np.zeros_like(tangent)
    for k in range(12, -1, -1):
        total = total * square + (-1) ** k / (2 * k + 1)
    angle = 8 * tangent * total
    flipped: FloatArray = np.where(x < 0, np.where(y < 0, -np.pi, np.pi) - angle, angle)
    return flipped


def rotation_matrix(rotvec: FloatArray) -> FloatArray:
    """Convert rotation vectors (..., 3) of at most 2 pi to matrices (..., 3, 3)."""
    cross = _cross_matrix(rotvec)
    a, b = _series(dot(rotvec, rotvec))[..., None, None]
    turned: FloatArray = np.eye(3) + a * cross + b * matmul(cross, cross)
    return turned


def _series(square: FloatArray) -> FloatArray:
    """Evaluate both series at squared angles (...), (2, ...)."""
    rows = _SERIES.reshape(_TERMS, 2, *(1,) * np.ndim(square))
    total = np.zeros((2, *np.shape(square)))
    for k in _ORDER:
        total *= square
        total += rows[k]
    return total


def _cross_matrix(vectors: FloatArray) -> FloatArray:
    """Return the cross-product matrices (..., 3, 3) of vectors."""
    matrix = np.zeros((*vectors.shape, 3))
    x = vectors[..., 0]
    y = vectors[..., 1]
    z = vectors[..., 2]
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -z, y, -x
    matrix[..., 1, 0], matrix[..., 2, 0], matrix[..., 2, 1] = z, -y, x
    return matrix
