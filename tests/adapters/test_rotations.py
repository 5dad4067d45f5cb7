"""Rotations in the forms that networks answer."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from physic_core.adapters.rotations import to_rotvecs


def test_matrices_and_vectors_are_the_same_rotations() -> None:
    vectors = np.random.default_rng(0).normal(0, 0.6, (3, 5, 3))
    matrices = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(3, 5, 3, 3)
    for given in (vectors, vectors.reshape(3, 15), matrices, matrices.astype(np.float32)):
        np.testing.assert_allclose(to_rotvecs(given, 5), vectors, atol=1e-5)


def test_a_matrix_that_is_no_rotation_becomes_nan() -> None:
    matrices = np.stack([np.eye(3), np.diag([-1.0, 1, 1]), np.zeros((3, 3)), np.full((3, 3), np.nan)])[None]
    found = to_rotvecs(matrices, 4)[0]
    np.testing.assert_array_equal(np.isnan(found).any(axis=1), [False, True, True, True])
