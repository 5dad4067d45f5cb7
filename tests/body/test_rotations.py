"""Rotations from directions: what each promises, over all directions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from physic_core.geometry.rotations import (
    cross,
    frame_from_axes,
    nearest_rotation,
    rotate,
    rotation_between,
    rotmat_to_rotvec,
    rotvec_to_rotmat_numpy,
    unit,
)

pytestmark = pytest.mark.quick

VECTOR = arrays(np.float64, (3,), elements=st.floats(-2, 2)).filter(
    lambda v: np.linalg.norm(v) > 1e-2
)
TURN = arrays(np.float64, (3,), elements=st.floats(-1.7, 1.7))


def is_rotation(matrix):
    return bool(np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-9) and np.linalg.det(matrix) > 0)


@settings(max_examples=50)
@example(np.array([1.0, 2.2e-9, 2.2e-9]), np.array([-1.0, 0.0, 0.0]))
@given(VECTOR, VECTOR)
def test_swing_is_the_shortest_turn(first, second):
    turn = rotation_between(first, second)
    assert is_rotation(turn)
    # Directions that are opposite within 1e-8 get half a turn: their sum has no more digits than
    # that.
    assert_allclose(turn @ unit(first), unit(second), atol=1e-7)
    cosine = float(unit(first) @ unit(second))
    assert abs(Rotation.from_matrix(turn).magnitude() - np.arccos(np.clip(cosine, -1, 1))) < 1e-6


@given(TURN, st.integers(0, 100))
def test_kabsch_finds_the_rotation_and_never_a_reflection(rotvec, seed):
    rng = np.random.default_rng(seed)
    source = rng.standard_normal((7, 3))
    target = source @ rotvec_to_rotmat_numpy(rotvec).T
    assert_allclose(nearest_rotation(target.T @ source), rotvec_to_rotmat_numpy(rotvec), atol=1e-9)
    assert is_rotation(nearest_rotation((target * [1, 1, -1]).T @ source))
    # In a plane one direction is left open, and is filled up to a rotation.
    flat = source * [1, 1, 0]
    assert_allclose(
        nearest_rotation((flat @ rotvec_to_rotmat_numpy(rotvec).T).T @ flat),
        rotvec_to_rotmat_numpy(rotvec),
        atol=1e-6,
    )


@given(VECTOR, VECTOR)
def test_the_frame_has_x_along_the_first_axis_and_y_towards_the_second(along, beside):
    if np.linalg.norm(cross(unit(along), unit(beside))) < 1e-3:
        return
    frame = frame_from_axes(along, beside)
    assert is_rotation(frame)
    assert_allclose(frame[:, 0], unit(along), atol=1e-12)
    assert frame[:, 1] @ beside > 0
    assert_allclose(rotate(frame, np.array([1.0, 0, 0])), unit(along), atol=1e-12)


def test_matrices_that_are_not_finite_give_nan_and_the_others_their_vectors():
    rotvecs = np.array([[0.1, 0.2, 0.3], [0.0, 0.0, 1.0]])
    rotations = rotvec_to_rotmat_numpy(rotvecs)
    rotations[0, 1, 2] = np.nan
    found = rotmat_to_rotvec(rotations)
    assert np.isnan(found[0]).all()
    assert_allclose(found[1], rotvecs[1], atol=1e-12)
