"""Bodies from SMPL parameters."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from physic_core.adapters.smpl import bodies_from_smpl, parameters_from_rotvecs
from physic_core.interfaces import BodyEstimator
from physic_testing import violations

RNG = np.random.default_rng(0)
POSE, BETAS, PLACE = RNG.normal(0, 0.4, (2, 24, 3)), RNG.normal(0, 1, (2, 10)), RNG.normal((0, 0, 4), 1, (2, 3))


def test_joints_0_to_21_keep_their_rotations_and_the_hands_are_dropped() -> None:
    bodies = bodies_from_smpl(POSE, BETAS, PLACE)
    p = bodies.parameters
    np.testing.assert_allclose(p.global_orient, POSE[:, 0], atol=1e-6)
    np.testing.assert_allclose(p.body_pose.reshape(2, 21, 3), POSE[:, 1:22], atol=1e-6)
    assert not p.left_hand_pose.any()
    assert not p.right_hand_pose.any()
    np.testing.assert_allclose(p.transl, PLACE, atol=1e-6)
    assert bodies.body_model == "smpl"
    assert bodies.joints is None
    assert violations(BodyEstimator, bodies, people=2) == []


def test_smpl_rotations_may_be_matrices_flat_vectors_or_22_joints() -> None:
    matrices = Rotation.from_rotvec(POSE.reshape(-1, 3)).as_matrix().reshape(2, 24, 3, 3)
    wanted = bodies_from_smpl(POSE, BETAS, PLACE).parameters
    for given in (matrices, POSE.reshape(2, 72), POSE[:, :22], matrices[:, :22]):
        found = bodies_from_smpl(given, BETAS, PLACE).parameters
        np.testing.assert_allclose(found.body_pose, wanted.body_pose, atol=1e-5)


def test_joints_that_smpl_has_not_are_not_numbers() -> None:
    joints = RNG.normal(0, 1, (2, 24, 3))
    bodies = bodies_from_smpl(POSE, BETAS, PLACE, joints=joints)
    assert bodies.joints is not None
    np.testing.assert_allclose(bodies.joints[:, :22], joints[:, :22], atol=1e-6)
    assert np.isnan(bodies.joints[:, 22:]).all()


def test_parameters_of_all_55_joints_land_in_their_fields() -> None:
    full = RNG.normal(0, 0.3, (1, 55, 3))
    p = parameters_from_rotvecs(full, BETAS[:1], PLACE[:1], expression=np.ones((1, 10)))
    rows = [p.global_orient, p.body_pose, p.jaw_pose, p.leye_pose, p.reye_pose, p.left_hand_pose, p.right_hand_pose]
    np.testing.assert_allclose(np.concatenate(rows, axis=1).reshape(1, 55, 3), full, atol=1e-6)
    assert p.expression.shape == (1, 10)
