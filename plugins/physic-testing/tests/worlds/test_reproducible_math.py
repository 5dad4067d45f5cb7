"""Arithmetic in a fixed order against numpy, SciPy and differences."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from physic_testing.worlds.reproducible_math import (
    apply,
    arctan2,
    dot,
    matmul,
    norm,
    rotation_gradient,
    rotation_matrix,
    round_to_grid,
    sin_cos,
)

_RNG = np.random.default_rng(0)
_ULP = 2.3e-16


def test_sines_and_cosines_are_right_over_a_few_turns() -> None:
    angles = np.concatenate([_RNG.uniform(-20, 20, 2000), np.arange(-8, 9) * np.pi / 4, [0.0]])
    sine, cosine = sin_cos(angles)
    np.testing.assert_allclose(sine, np.sin(angles), rtol=0, atol=8 * _ULP)
    np.testing.assert_allclose(cosine, np.cos(angles), rtol=0, atol=8 * _ULP)


def test_the_angle_of_a_point_is_right_in_all_quadrants_and_on_the_axes() -> None:
    y, x = np.concatenate([_RNG.normal(size=(2, 2000)), [[0, 0, 1, -1, 0], [1, -1, 0, 0, 0]]], axis=1)
    np.testing.assert_allclose(arctan2(y, x), np.arctan2(y, x), rtol=0, atol=8 * _ULP)


def test_products_and_lengths_are_those_of_linear_algebra() -> None:
    a, b, vectors = _RNG.normal(size=(5, 3, 3)), _RNG.normal(size=(5, 3, 3)), _RNG.normal(size=(5, 3))
    np.testing.assert_allclose(matmul(a, b), a @ b, atol=1e-14)
    np.testing.assert_allclose(apply(a, vectors), np.einsum("ijk,ik->ij", a, vectors), atol=1e-14)
    np.testing.assert_allclose(apply(a[0], vectors), vectors @ a[0].T, atol=1e-14)
    np.testing.assert_allclose(dot(vectors, vectors), norm(vectors) ** 2, atol=1e-14)
    np.testing.assert_allclose(norm(vectors), np.linalg.norm(vectors, axis=1), atol=1e-14)


def test_rotations_are_those_of_scipy_also_without_a_turn() -> None:
    vectors = np.concatenate([_RNG.normal(size=(50, 3)), [[0.0, 0.0, 0.0], [np.pi, 0.0, 0.0], [1e-9, 0.0, 0.0]]])
    np.testing.assert_allclose(rotation_matrix(vectors), Rotation.from_rotvec(vectors).as_matrix(), atol=1e-15, rtol=0)


def test_the_gradient_of_a_rotation_is_right() -> None:
    vectors, weights, step = _RNG.normal(size=(20, 3)), _RNG.normal(size=(20, 3, 3)), 1e-5
    vectors[0] = 0
    wanted = [
        ((rotation_matrix(vectors + step * axis) - rotation_matrix(vectors - step * axis)) * weights).sum(axis=(1, 2))
        / (2 * step)
        for axis in np.eye(3)
    ]
    np.testing.assert_allclose(rotation_gradient(vectors, weights), np.stack(wanted, axis=1), atol=1e-8)


def test_a_last_bit_is_lost_on_the_grid() -> None:
    values = _RNG.normal(size=1000)
    assert np.array_equal(round_to_grid(values), round_to_grid(np.nextafter(values, 10)))
    np.testing.assert_allclose(round_to_grid(values), values, rtol=0, atol=0.5**31)
