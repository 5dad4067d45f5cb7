"""Joint angles of poses whose angles are known, and sizes that follow from the shape."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.body.joint_angles import joint_angles, joints_of_parts
from physic_core.body.joints import JOINT_INDEX

X, Y, Z = np.eye(3)  # left, up, forward


def posed(**turns):
    """The angles of a T-pose with some joints turned by vectors in degrees, without zeros."""
    pose = np.zeros((21, 3))
    for name, turn in turns.items():
        pose[JOINT_INDEX[name] - 1] = np.deg2rad(turn)
    angles = joint_angles(pose.reshape(-1))
    return {name: angle for name, angle in angles.items() if abs(angle) > 1e-6}


# T-pose: arms are raised sideways by 90.
ARMS = {
    f"{side}_shoulder_{name}": 90
    for side in ("left", "right")
    for name in ("abduction", "elevation")
}


@pytest.mark.parametrize(
    ("turns", "angles"),
    [
        ({"left_knee": 70 * X}, {"left_knee_flexion": 70}),
        ({"right_hip": -30 * X}, {"right_hip_flexion": 30}),
        ({"left_hip": 20 * Z}, {"left_hip_abduction": 20}),
        ({"right_hip": 20 * Z}, {"right_hip_abduction": -20}),
        ({"left_hip": -15 * Y}, {"left_hip_rotation": 15}),
        ({"right_hip": 15 * Y}, {"right_hip_rotation": 15}),
        ({"left_ankle": -10 * X}, {"left_ankle_dorsiflexion": 10}),
        ({"spine1": 10 * X, "spine3": 15 * X}, {"trunk_flexion": 25}),
        ({"spine2": -12 * Z}, {"trunk_bending": -12}),
        ({"neck": 12 * Y, "head": 8 * Y}, {"neck_rotation": 20}),
        ({"left_elbow": -80 * Y}, {"left_elbow_flexion": 80}),
        ({"right_elbow": 80 * Y}, {"right_elbow_flexion": 80}),
        ({"right_elbow": 25 * X}, {"right_elbow_pronation": 25}),
    ],
)
def test_one_turn_is_one_angle(turns, angles):
    assert posed(**turns) == pytest.approx(ARMS | angles, abs=1e-6)


def test_arms_at_the_sides_and_forward():
    down = posed(left_shoulder=-90 * Z, right_shoulder=90 * Z)
    assert down == {}
    forward = posed(left_shoulder=-90 * Y, right_shoulder=60 * Z)
    assert forward["left_shoulder_elevation"] == pytest.approx(90)
    assert forward["left_shoulder_flexion"] == pytest.approx(90)
    assert forward["right_shoulder_elevation"] == pytest.approx(30)


def test_a_person_without_a_body_has_no_angles():
    assert np.isnan(list(joint_angles(np.full(63, np.nan)).values())).all()


def test_joints_beside_what_is_unseen():
    assert joints_of_parts(("left_lower_leg", "right_hand")) == ("left_knee", "left_ankle")
