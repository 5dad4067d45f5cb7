"""Arms near the thigh of a straight hip rarely touch it; those of who sits or bends may."""

from __future__ import annotations

import torch

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.contact.straight_hips import arms_at_straight_hips
from physic_core.engine.joint.limbs import straight_hips
from physic_core.engine.joint.own_hands import hanging_hands

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


def test_the_hips_of_who_stands_are_straight_and_those_of_who_sits_are_not():
    assert straight_hips(posed()).tolist() == [[True, True]]
    assert straight_hips(posed(knee=(0.5, 0.9))).tolist() == [[False, True]]


def test_a_straight_arm_at_a_straight_hip_hangs():
    assert hanging_hands(posed()).tolist() == [[True, True]]
    assert hanging_hands(posed(elbow=(0.5, 1.3), wrist=(0.5, 1.05))).tolist() == [[False, True]]
    assert hanging_hands(posed(knee=(0.5, 0.9))).tolist() == [[False, True]]


def test_only_the_arm_and_the_thigh_of_one_side_are_flagged(body):
    names, part = body.part_names, body.part_of_vertex
    hand, thigh, torso, other = (
        int((part == names.index(name)).nonzero()[0]) for name in ("left_hand", "left_upper_leg", "torso", "right_hand")
    )
    nearest = torch.full((1, body.num_vertices), torso)
    nearest[0, hand], nearest[0, thigh], nearest[0, other] = thigh, hand, thigh
    flagged = arms_at_straight_hips(body, posed(), nearest)
    assert flagged[0].nonzero()[:, 0].tolist() == sorted((hand, thigh))
    assert not arms_at_straight_hips(body, posed(knee=(0.5, 0.9)), nearest).any()
