"""Which joints the keypoints show."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.adapters.observed import _SKELETONS, observed_joints
from physic_core.body.joints import JOINT_INDEX, JOINT_NAMES
from physic_core.body.landmarks import DETECTED
from physic_core.types import Keypoints


def seen(skeleton: str, *hidden: str, places: dict[str, tuple[float, float]] | None = None) -> set[str]:
    """Names of the joints that are not observed, where these keypoints are hidden, or elsewhere."""
    names = DETECTED[skeleton]
    points, confidence = np.full((1, len(names), 2), 50.0), np.full((1, len(names)), 0.9)
    confidence[0, [names.index(name) for name in hidden]] = 0.3
    for name, place in (places or {}).items():
        points[0, names.index(name)] = place
    found = observed_joints(Keypoints(points, confidence, skeleton), 100, 200)
    assert found is not None
    return {JOINT_NAMES[i] for i in np.flatnonzero(~found[0])}


@pytest.mark.parametrize("skeleton", sorted(_SKELETONS))
def test_points_of_the_tables_are_those_of_their_skeletons(skeleton: str) -> None:
    rows, names = _SKELETONS[skeleton], DETECTED[skeleton]
    for limb, both in rows.limbs.items():
        assert [names[i] for i in both] == [f"left_{limb}", f"right_{limb}"]
    for side, feet, hand in zip(("left", "right"), rows.feet, rows.hands, strict=True):
        assert all(names[i].startswith(side) for i in (*feet, *hand))
        assert all(names[i].endswith(("heel", "toe", "foot_tip")) for i in feet)
    assert all(names[i] == "nose" or names[i].endswith(("_eye_surface", "_ear_surface")) for i in rows.face)


@pytest.mark.parametrize("skeleton", sorted(_SKELETONS))
def test_all_keypoints_show_all_joints_and_one_hides_its_own(skeleton: str) -> None:
    assert seen(skeleton) == set()
    assert seen(skeleton, "left_knee") == {"left_knee"}
    assert seen(skeleton, "right_elbow") == {"right_elbow"}
    fingers = {name for name in JOINT_INDEX if name.startswith("left_") and name[-1].isdigit()}
    assert seen(skeleton, "left_wrist") == {"left_wrist", *fingers}


def test_neighbours_go_together() -> None:
    assert seen("coco17", "left_ankle") == {"left_ankle", "left_foot"}
    assert seen("coco23", "left_ankle") == {"left_ankle"}
    assert seen("coco17", "left_hip", "right_hip") == {"left_hip", "right_hip", "pelvis", "spine1", "spine2"}
    face = [name for name in DETECTED["coco17"] if name == "nose" or name.endswith("_surface")]
    assert seen("coco17", *face) == {"neck", "head", "jaw", "left_eye", "right_eye"}
    assert seen("coco17", *face[1:]) == set()


def test_points_outside_of_the_image_are_not_seen() -> None:
    assert seen("coco17", places={"left_knee": (50.0, 99.6)}) == {"left_knee"}
    assert seen("coco17", places={"left_knee": (-0.4, 99.4)}) == set()


def test_fingers_need_half_of_their_points() -> None:
    hand = list(DETECTED["coco_wholebody133"][112:133])
    assert "right_index1" in seen("coco_wholebody133", *hand[:11])
    assert "right_wrist" not in seen("coco_wholebody133", *hand)


def test_an_unknown_skeleton_says_nothing() -> None:
    assert observed_joints(Keypoints(np.zeros((1, 3, 2)), np.ones((1, 3)), "a new one"), 10, 10) is None
