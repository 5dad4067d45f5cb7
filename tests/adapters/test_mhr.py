"""Joints of SMPL-X from the keypoints of an MHR body."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.adapters.mhr import joints_from_keypoints
from physic_core.body.joints import JOINT_INDEX
from physic_testing.conformance.true_keypoints import world_mhr_keypoints
from physic_testing.worlds import build_world


@pytest.mark.parametrize(("name", "most_mm"), [("sit_on_chair", 12), ("kneel", 35)])
def test_feet_are_turned_towards_their_toes(name: str, most_mm: float) -> None:
    """The true tips of the toes, on the skin, give the joint that toes bend at; who kneels has bent them."""
    world = build_world(name)
    ankles, feet = world.joints[:, [7, 8]], world.joints[:, [10, 11]]
    points = np.zeros((len(ankles), 70, 3), np.float32)
    points[:, [13, 14]] = ankles
    points[:, [15, 16, 18, 19]] = world_mhr_keypoints(world)[:, [15, 16, 18, 19]]
    found = joints_from_keypoints(points)[:, [JOINT_INDEX["left_foot"], JOINT_INDEX["right_foot"]]]
    assert 1000 * np.linalg.norm(found - feet, axis=2).mean() < most_mm
