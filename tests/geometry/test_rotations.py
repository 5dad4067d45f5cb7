"""Rotations: vectors to matrices as roma converts them, in value and slope, and back to angles and
quaternions.
"""

from __future__ import annotations

import math

import pytest
import torch
from torch.nn.functional import normalize
from torch.testing import assert_close

from physic_core.geometry.rotations import rotmat_to_euler, rotmat_to_quat
from physic_core.geometry.rotvecs import rotvec_to_rotmat

pytestmark = pytest.mark.quick


@pytest.fixture(scope="module")
def roma():
    import roma  # which imports torch._dynamo, for longer than a second

    return roma


ANGLES = [0.0, 1e-8, 1e-4, 0.03, 0.04, 0.49, 0.51, 1.0, 3.0, math.pi, 5.0]


def turns(angle, dtype):
    axes = torch.randn(20, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    return (angle * normalize(axes, dim=-1)).to(dtype).requires_grad_()


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 2e-6), (torch.float64, 2e-12)])
def test_value_and_gradient_agree_with_roma(roma, angle, dtype, tolerance):
    rotvec = turns(angle, dtype)
    weights = torch.randn(20, 3, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    got = rotvec_to_rotmat(rotvec)
    want = roma.rotvec_to_rotmat(rotvec.double())
    assert_close(got.double(), want, atol=tolerance, rtol=0)
    (slope,) = torch.autograd.grad((got * weights.to(dtype)).sum(), rotvec)
    (expected,) = torch.autograd.grad((want * weights).sum(), rotvec)
    # roma's own series begin so near to zero that its slope loses half of the digits there.
    near_zero = 0 < angle < 1e-3
    assert_close(
        slope.double(), expected.double(), atol=max(5 * tolerance, 1e-7 * near_zero), rtol=0
    )


@pytest.mark.parametrize("axes", ["XYZ", "ZXY", "xyz"])
def test_angles_and_quaternions_of_matrices_are_those_of_roma(roma, axes):
    matrices = roma.random_rotmat(50).double()
    angles = rotmat_to_euler(axes, matrices.numpy())
    assert torch.allclose(roma.euler_to_rotmat(axes, torch.from_numpy(angles)), matrices, atol=1e-7)
    turns = torch.from_numpy(rotmat_to_quat(matrices.numpy().reshape(5, 10, 3, 3)).reshape(50, 4))
    assert torch.allclose(roma.unitquat_to_rotmat(turns), matrices, atol=1e-7)


def test_coinciding_axes_give_angles_of_the_same_rotation_without_a_warning(roma):
    matrix = roma.euler_to_rotmat("xyz", torch.tensor([0.3, math.pi / 2, 0.4], dtype=torch.float64))
    angles = rotmat_to_euler("xyz", matrix.numpy())
    assert angles.shape == (3,)
    assert angles[2] == 0
    assert torch.allclose(roma.euler_to_rotmat("xyz", torch.from_numpy(angles)), matrix, atol=1e-7)
