"""Which SMPL-X joint each keypoint of an MHR body is."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.adapters.mhr import JOINT_BY_KEYPOINT, joints_from_keypoints
from physic_core.body.joints import JOINT_INDEX
from physic_testing.conformance.true_keypoints import world_mhr_keypoints
from physic_testing.worlds import build_world

# Names of the 70 keypoints as SAM 3D Body lists them, and the joints of SMPL-X that mean the same.
NAMES = {
    1: "left_eye", 2: "right_eye", 5: "left_shoulder", 6: "right_shoulder", 7: "left_elbow", 8: "right_elbow",
    9: "left_hip", 10: "right_hip", 11: "left_knee", 12: "right_knee", 13: "left_ankle", 14: "right_ankle",
    22: "right_thumb3", 23: "right_thumb2", 24: "right_thumb1", 26: "right_index3", 27: "right_index2",
    28: "right_index1", 30: "right_middle3", 31: "right_middle2", 32: "right_middle1", 34: "right_ring3",
    35: "right_ring2", 36: "right_ring1", 38: "right_pinky3", 39: "right_pinky2", 40: "right_pinky1",
    41: "right_wrist", 43: "left_thumb3", 44: "left_thumb2", 45: "left_thumb1", 47: "left_index3",
    48: "left_index2", 49: "left_index1", 51: "left_middle3", 52: "left_middle2", 53: "left_middle1",
    55: "left_ring3", 56: "left_ring2", 57: "left_ring1", 59: "left_pinky3", 60: "left_pinky2",
    61: "left_pinky1", 62: "left_wrist",
}  # fmt: skip


def test_every_keypoint_is_the_joint_of_the_same_name() -> None:
    assert {number: JOINT_INDEX[name] for number, name in NAMES.items()} == JOINT_BY_KEYPOINT


def test_joints_without_a_keypoint_are_not_numbers() -> None:
    joints = joints_from_keypoints(np.zeros((1, 70, 3), np.float32))[0]
    unknown = np.flatnonzero(np.isnan(joints).all(axis=1)).tolist()
    assert unknown == [JOINT_INDEX[n] for n in (
        "pelvis", "spine1", "spine2", "spine3", "neck", "left_collar", "right_collar",
        "head", "jaw",
    )]  # fmt: skip


@pytest.mark.parametrize(("name", "most_mm"), [("stand", 12), ("sit_on_chair", 12), ("walk", 15), ("kneel", 35)])
def test_feet_are_turned_towards_their_toes(name: str, most_mm: float) -> None:
    """The true tips of the toes, on the skin, give the joint that toes bend at; who kneels has bent them."""
    world = build_world(name)
    ankles, feet = world.joints[:, [7, 8]], world.joints[:, [10, 11]]
    points = np.zeros((len(ankles), 70, 3), np.float32)
    points[:, [13, 14]] = ankles
    points[:, [15, 16, 18, 19]] = world_mhr_keypoints(world)[:, [15, 16, 18, 19]]
    found = joints_from_keypoints(points)[:, [JOINT_INDEX["left_foot"], JOINT_INDEX["right_foot"]]]
    apart = 1000 * np.linalg.norm(found - feet, axis=2).mean()
    print(f"{apart:.1f} mm")
    assert apart < most_mm
