"""People who stand in symmetry about a middle are told apart by the turn that the background gives."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physic_scene.background import BackgroundTurn
from physic_scene.matching import MatchingSettings, match_pair
from physic_scene.observations import COLOUR_GROUPS, PhotoPeople
from physic_scene.rigid import Pose, angle_deg

MIDDLE = np.array([0.0, 0.0, 4.0])
TURN = Rotation.from_euler("y", 40, degrees=True).as_matrix()
HALF_TURN = Rotation.from_euler("y", 180, degrees=True).as_matrix()


def photo(joints: np.ndarray) -> PhotoPeople:
    """Return people in like clothes with joints (N, 55, 3); the matching uses no keypoints."""
    n = len(joints)
    return PhotoPeople(
        rows=tuple(range(n)),
        K=np.eye(3),
        focal_sigma=0.1,
        skeleton=None,
        points=np.zeros((n, 0, 2)),
        confidence=np.zeros((n, 0)),
        landmarks=np.zeros((n, 0, 3)),
        joints=joints,
        rotations=np.zeros((n, 55, 3, 3)),
        betas=np.zeros((n, 10)),
        stature=np.full(n, 1.75),
        colours=np.full((n, len(COLOUR_GROUPS), 3), 40.0),
        pattern=np.ones(n),
        size_px=np.full(n, 400.0),
        up=np.full(3, np.nan),
    )


@pytest.fixture
def facing_each_other():
    """Return two photos of two people who face each other, and the motion between the cameras."""
    rng = np.random.default_rng(5)
    body = rng.normal(0, [0.2, 0.5, 0.2], (55, 3))
    body[0] = 0
    person = body + np.array([0.8, 0, 0])
    joints = np.stack([person, person @ HALF_TURN.T]) + MIDDLE
    motion = Pose(TURN, MIDDLE - TURN @ MIDDLE)
    return photo(joints), photo(motion.to_camera(joints)), motion


@pytest.mark.parametrize("swapped", [False, True])
def test_the_background_tells_people_apart_who_face_each_other(facing_each_other, swapped):
    one, two, motion = facing_each_other
    rotation = motion.rotation @ HALF_TURN if swapped else motion.rotation
    found = match_pair(one, two, MatchingSettings(), BackgroundTurn(rotation, 20.0))
    assert {(i, j) for i, j, _ in found.pairs} == ({(0, 1), (1, 0)} if swapped else {(0, 0), (1, 1)})
    assert angle_deg(found.motion.rotation, rotation) < 1


def test_a_background_that_matches_by_chance_changes_nothing(facing_each_other):
    one, two, _ = facing_each_other
    alone = match_pair(one, two, MatchingSettings())
    chance = BackgroundTurn(Rotation.from_euler("x", 90, degrees=True).as_matrix(), -9.2)
    found = match_pair(one, two, MatchingSettings(), chance)
    assert found.pairs == alone.pairs
    assert found.score == pytest.approx(alone.score)
