"""Bodies of SMPL and MHR networks, and the joints that keypoints show."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core.body import load_body
from physic_core.body.joints import JOINT_INDEX, JOINT_NAMES
from physic_core.interfaces import BodyEstimator
from physic_core.types import SKELETONS, Keypoints
from physic_networks.bodies import (
    bodies_from_smpl,
    joints_from_mhr70,
    observed_joints,
)
from physic_testing import violations
from physic_testing.worlds import load_world

RNG = np.random.default_rng(0)
POSE = RNG.normal(0, 0.4, (2, 24, 3))
BETAS = RNG.normal(0, 1, (2, 10))
PLACE = RNG.normal((0, 0, 4), 1, (2, 3))


def test_joints_0_to_21_keep_their_rotations_and_the_hands_are_dropped():
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


TOES = ("left_big", "left_small", "right_big", "right_small")


@pytest.mark.parametrize(("name", "most_mm"), [("sit_on_chair", 12), ("kneel", 35)])
def test_feet_are_turned_towards_their_toes(name, most_mm):
    """The true tips of the toes, on the skin, give the joint that toes bend at; who kneels has bent
    them.
    """
    world = load_world(name)
    ankles = world.joints[:, [7, 8]]
    feet = world.joints[:, [10, 11]]
    points = np.zeros((len(ankles), 70, 3), np.float32)
    points[:, [13, 14]] = ankles
    regressor = load_body("embedded").regressor("coco23")
    joints, vertices = (torch.from_numpy(part.copy()) for part in (world.joints, world.vertices))
    names = SKELETONS["coco23"].names
    toes = [names.index(f"{side}_toe") for side in TOES]
    points[:, [15, 16, 18, 19]] = regressor(joints, vertices[:, regressor.vertex_ids])[:, toes]
    found = joints_from_mhr70(points)[:, [JOINT_INDEX["left_foot"], JOINT_INDEX["right_foot"]]]
    assert 1000 * np.linalg.norm(found - feet, axis=2).mean() < most_mm


def seen(skeleton, *hidden, places=None):
    """Names of the joints that are not observed, where these keypoints are hidden, or elsewhere."""
    names = SKELETONS[skeleton].names
    points = np.full((1, len(names), 2), 50.0)
    confidence = np.full((1, len(names)), 0.9)
    confidence[0, [names.index(name) for name in hidden]] = 0.3
    for name, place in (places or {}).items():
        points[0, names.index(name)] = place
    found = observed_joints(Keypoints(points, confidence, skeleton), 100, 200)
    assert found is not None
    return {JOINT_NAMES[i] for i in np.flatnonzero(~found[0])}


@pytest.mark.parametrize(
    "skeleton", ["blazepose33", "coco17", "coco23", "coco_wholebody133", "halpe26", "wholebody69"]
)
def test_all_keypoints_show_all_joints_and_one_hides_its_own(skeleton):
    assert seen(skeleton) == set()
    assert seen(skeleton, "left_knee") == {"left_knee"}
    assert seen(skeleton, "right_elbow") == {"right_elbow"}
    fingers = {name for name in JOINT_INDEX if name.startswith("left_") and name[-1].isdigit()}
    assert seen(skeleton, "left_wrist") == {"left_wrist", *fingers}


def test_points_outside_of_the_image_are_not_seen():
    assert seen("coco17", places={"left_knee": (50.0, 99.6)}) == {"left_knee"}
    assert seen("coco17", places={"left_knee": (-0.4, 99.4)}) == set()
