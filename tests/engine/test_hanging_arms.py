"""Arms that hang beside the thigh do not touch it; arms that are bent or held away may."""

from __future__ import annotations

import pytest
import torch

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.contact.hanging_arms import beside_hanging_arm, hanging_arms

STANDING = {
    "neck": (0.0, 1.5),
    "pelvis": (0.0, 1.0),
    "hip": (0.1, 0.9),
    "knee": (0.1, 0.5),
    "shoulder": (0.2, 1.4),
    "elbow": (0.2, 1.1),
    "wrist": (0.2, 0.85),
}


def posed(**moved: tuple[float, float]) -> torch.Tensor:
    """Joints (1, 55, 3) of a person who stands with both arms down; changes are those of the left side."""
    joints = torch.zeros(1, 55, 3, dtype=torch.float64)
    for name, place in STANDING.items():
        for side, sign in (("left_", 1), ("right_", -1)) if name not in ("neck", "pelvis") else (("", 1),):
            x, y = moved.get(name, place) if side != "right_" else place
            joints[0, JOINT_INDEX[f"{side}{name}"], :2] = torch.tensor([sign * x, y])
    return joints


def test_both_arms_of_a_standing_person_hang():
    assert hanging_arms(posed()).tolist() == [[True, True]]


@pytest.mark.parametrize(
    "moved", [{"wrist": (0.4, 0.9)}, {"elbow": (0.5, 1.3), "wrist": (0.5, 1.05)}, {"knee": (0.5, 0.9)}]
)
def test_an_arm_away_from_the_thigh_a_bent_arm_and_a_bent_hip_do_not(moved):
    assert hanging_arms(posed(**moved)).tolist() == [[False, True]]


def test_only_the_arm_and_the_thigh_of_one_side_are_flagged(body):
    names, part = body.part_names, body.part_of_vertex
    hand, thigh, torso, other = (
        int((part == names.index(name)).nonzero()[0]) for name in ("left_hand", "left_upper_leg", "torso", "right_hand")
    )
    nearest = torch.full((1, body.num_vertices), torso)
    nearest[0, hand], nearest[0, thigh], nearest[0, other] = thigh, hand, thigh
    flagged = beside_hanging_arm(body, posed(), nearest)
    assert flagged[0].nonzero()[:, 0].tolist() == sorted((hand, thigh))
    assert not beside_hanging_arm(body, posed(wrist=(0.4, 0.9)), nearest).any()
