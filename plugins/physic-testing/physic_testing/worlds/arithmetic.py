"""Arithmetic that gives the same bits on every CPU, whatever its vector width and the number of threads.

A BLAS, ``einsum`` and sines of arrays differ in the last bit from kernel to kernel. The fits and decisions that make a
world turn one bit into centimetres. So everything here is sums, products, quotients and roots of arrays in a fixed
order: IEEE 754 rounds each of them in exactly one way.
"""

from __future__ import annotations

from math import factorial
from typing import TYPE_CHECKING, Any

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
    "on_grid",
    "rotation",
    "rotation_gradient",
    "sine_cosine",
]

_GRID = float(1 << 30)
"""Steps a metre or a radian: a nanometre."""

_QUARTER = (1.5707963267341256, 6.077100506506192e-11)
"""A quarter of a turn in two parts: multiples of the first are exact."""

_TERMS = 18
_ORDER = range(_TERMS - 1, -1, -1)
# Of sin(t) / t, (1 - cos(t)) / t^2 and their derivatives, as series in t^2.
_SERIES: NDArray[np.float64] = np.array(
    [
        [
            (-1) ** k / factorial(2 * k + 1),
            (-1) ** k / factorial(2 * k + 2),
            (-1) ** (k + 1) * (k + 1) / factorial(2 * k + 3),
            (-1) ** (k + 1) * (k + 1) / factorial(2 * k + 4),
        ]
        for k in range(_TERMS)
    ]
)


def on_grid(values: FloatArray | float) -> FloatArray:
    """Values rounded to 2^-30.

    What comes of the C library's sines and powers may differ in its last bit between machines; on the grid it does not.
    """
    rounded: FloatArray = np.round(np.asarray(values, np.float64) * _GRID) / _GRID
    return rounded


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Inner products (...) of vectors (..., 3)."""
    product: FloatArray = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
    return product


def norm(vectors: FloatArray) -> FloatArray:
    """Lengths (...) of vectors (..., 3)."""
    length: FloatArray = np.sqrt(dot(vectors, vectors))
    return length


def apply(matrix: FloatArray, vectors: FloatArray) -> FloatArray:
    """Matrices (..., 3, 3) times vectors (..., 3)."""
    product: FloatArray = (
        matrix[..., :, 0] * vectors[..., 0, None]
        + matrix[..., :, 1] * vectors[..., 1, None]
        + matrix[..., :, 2] * vectors[..., 2, None]
    )
    return product


def matmul(a: FloatArray, b: FloatArray) -> FloatArray:
    """Matrices (..., i, 3) times matrices (..., 3, j)."""
    product: FloatArray = (
        a[..., :, 0, None] * b[..., None, 0, :]
        + a[..., :, 1, None] * b[..., None, 1, :]
        + a[..., :, 2, None] * b[..., None, 2, :]
    )
    return product


def sine_cosine(angle: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """Sine and cosine of angles, radians, of a few turns at most; to 1e-15."""
    angle = np.asarray(angle, np.float64)
    quarter = np.round(angle / _QUARTER[0])
    rest = angle - quarter * _QUARTER[0] - quarter * _QUARTER[1]
    square = rest * rest
    a, b = _series(square, 2)
    sine, cosine = rest * a, 1 - square * b
    turn = np.mod(quarter, 4)
    choice = [turn == 0, turn == 1, turn == 2]
    return np.select(choice, [sine, cosine, -sine], -cosine), np.select(choice, [cosine, -sine, -cosine], sine)


def arctan2(y: FloatArray | float, x: FloatArray | float) -> FloatArray:
    """The angle of points (x, y) from the x axis, radians in [-pi, pi]; to 1e-15. 0 at the origin."""
    y, x = np.asarray(y, np.float64), np.asarray(x, np.float64)
    tangent = y / np.maximum(np.sqrt(x * x + y * y) + np.abs(x), 1e-300)  # of half the angle from the nearer half axis
    for _ in range(2):
        tangent = tangent / (1 + np.sqrt(1 + tangent * tangent))
    square, total = tangent * tangent, np.zeros_like(tangent)
    for k in range(12, -1, -1):
        total = total * square + (-1) ** k / (2 * k + 1)
    angle = 8 * tangent * total
    flipped: FloatArray = np.where(x < 0, np.where(y < 0, -np.pi, np.pi) - angle, angle)
    return flipped


def rotation(rotvec: FloatArray) -> FloatArray:
    """Rotation vectors (..., 3) of at most a turn -> matrices (..., 3, 3)."""
    cross = _cross_matrix(rotvec)
    a, b = _series(dot(rotvec, rotvec), 2)[..., None, None]
    turned: FloatArray = np.eye(3) + a * cross + b * matmul(cross, cross)
    return turned


def rotation_gradient(rotvec: FloatArray, by_rotation: FloatArray) -> FloatArray:
    """A gradient by the matrices of rotation vectors (n, 3), (n, 3, 3) -> by the vectors (n, 3)."""
    cross = _cross_matrix(rotvec)
    a, b, slope_a, slope_b = _series(dot(rotvec, rotvec), 4)
    by_cross = a[:, None] * _uncrossed(by_rotation)
    turned = np.swapaxes(cross, -1, -2)
    by_square = b[:, None] * _uncrossed(matmul(by_rotation, turned) + matmul(turned, by_rotation))
    along = slope_a * _inner(by_rotation, cross) + slope_b * _inner(by_rotation, matmul(cross, cross))
    gradient: FloatArray = by_cross + by_square + 2 * along[:, None] * rotvec
    return gradient


def _series(square: FloatArray, count: int) -> FloatArray:
    """(count, ...) the first series at squared angles (...)."""
    rows = _SERIES[:, :count].reshape(_TERMS, count, *(1,) * np.ndim(square))
    total = np.zeros((count, *np.shape(square)))
    for k in _ORDER:
        total *= square
        total += rows[k]
    return total


def _cross_matrix(vectors: FloatArray) -> FloatArray:
    matrix = np.zeros((*vectors.shape, 3))
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -z, y, -x
    matrix[..., 1, 0], matrix[..., 2, 0], matrix[..., 2, 1] = z, -y, x
    return matrix


def _uncrossed(matrix: FloatArray) -> FloatArray:
    """The gradient (..., 3) by a vector of what the gradient (..., 3, 3) is by its cross-product matrix."""
    return np.stack(
        [
            matrix[..., 2, 1] - matrix[..., 1, 2],
            matrix[..., 0, 2] - matrix[..., 2, 0],
            matrix[..., 1, 0] - matrix[..., 0, 1],
        ],
        -1,
    )


def _inner(a: FloatArray, b: FloatArray) -> Any:
    return dot(dot(a, b), np.ones(3))
