"""SMPL-X-named parameters <-> rotation matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from physic_core.body import JOINT_INDEX
from physic_core.body.bones import parameters_from_rotations, rotations_from_parameters
from physic_core.errors import BodyModelError
from physic_core.geometry.rotvecs import rotvec_to_rotmat

pytestmark = pytest.mark.quick


def test_parameters_and_rotations_convert_back_and_forth(random_pose):
    parameters = parameters_from_rotations(
        random_pose["rotations"], random_pose["betas"], None, random_pose["transl"]
    )
    assert len(parameters) == 3
    assert parameters.expression.shape == (3, 0)
    assert parameters.body_pose.dtype == np.float32
    assert torch.allclose(
        rotations_from_parameters(parameters), random_pose["rotations"], atol=1e-6
    )
    assert np.array_equal(parameters.betas, random_pose["betas"].numpy())
    assert np.array_equal(parameters.transl, random_pose["transl"].numpy())


def parameters_of(rotations):
    return parameters_from_rotations(
        rotations, torch.zeros(1, 16), torch.zeros(1, 2), torch.zeros(1, 3)
    )


@pytest.mark.parametrize(
    ("joint", "field", "first"),
    [
        ("pelvis", "global_orient", 0),
        ("right_wrist", "body_pose", 60),
        ("jaw", "jaw_pose", 0),
        ("left_eye", "leye_pose", 0),
        ("right_eye", "reye_pose", 0),
        ("left_thumb3", "left_hand_pose", 42),
        ("right_pinky2", "right_hand_pose", 21),
    ],
)
def test_every_field_holds_its_joints(joint, field, first):
    rotvec = torch.tensor([0.1, -0.2, 0.3])
    rotations = torch.eye(3).repeat(1, 55, 1, 1)
    rotations[0, JOINT_INDEX[joint]] = rotvec_to_rotmat(rotvec)
    parameters = parameters_of(rotations)
    assert_allclose(getattr(parameters, field)[0, first : first + 3], rotvec, atol=1e-6)
    total = sum(np.abs(getattr(parameters, name)).sum() for name in vars(parameters))
    assert total == pytest.approx(0.6, abs=1e-5)


def test_half_turns_convert_back_and_forth():
    """At pi the sign of the rotation vector is open, the rotation is not."""
    rotations = torch.eye(3).repeat(1, 55, 1, 1)
    rotations[0, 0] = torch.diag(torch.tensor([1.0, -1.0, -1.0]))  # upright in the camera's frame
    parameters = parameters_of(rotations)
    assert torch.allclose(rotations_from_parameters(parameters), rotations, atol=1e-6)


def test_parameters_of_another_shape_are_refused():
    parameters = parameters_of(torch.eye(3).repeat(1, 55, 1, 1))
    with pytest.raises(BodyModelError, match=r"left_hand_pose must be \(1, 45\), got \(1, 12\)"):
        rotations_from_parameters(replace(parameters, left_hand_pose=np.zeros((1, 12), np.float32)))
