"""Which joints the keypoints show."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.adapters.observed import observed_joints
from physic_core.body.joints import JOINT_INDEX, JOINT_NAMES
from physic_core.types import SKELETONS, Keypoints


def seen(skeleton: str, *hidden: str, places: dict[str, tuple[float, float]] | None = None) -> set[str]:
    """Names of the joints that are not observed, where these keypoints are hidden, or elsewhere."""
    names = SKELETONS[skeleton].names
    points, confidence = np.full((1, len(names), 2), 50.0), np.full((1, len(names)), 0.9)
    confidence[0, [names.index(name) for name in hidden]] = 0.3
    for name, place in (places or {}).items():
        points[0, names.index(name)] = place
    found = observed_joints(Keypoints(points, confidence, skeleton), 100, 200)
    assert found is not None
    return {JOINT_NAMES[i] for i in np.flatnonzero(~found[0])}


@pytest.mark.parametrize("skeleton", ["blazepose33", "coco17", "coco23", "coco_wholebody133", "halpe26", "wholebody69"])
def test_all_keypoints_show_all_joints_and_one_hides_its_own(skeleton: str) -> None:
    assert seen(skeleton) == set()
    assert seen(skeleton, "left_knee") == {"left_knee"}
    assert seen(skeleton, "right_elbow") == {"right_elbow"}
    fingers = {name for name in JOINT_INDEX if name.startswith("left_") and name[-1].isdigit()}
    assert seen(skeleton, "left_wrist") == {"left_wrist", *fingers}


def test_neighbouring_joints_are_observed_together() -> None:
    assert seen("coco17", "left_ankle") == {"left_ankle", "left_foot"}
    assert seen("coco23", "left_ankle") == {"left_ankle"}
    assert seen("coco17", "left_hip", "right_hip") == {"left_hip", "right_hip", "pelvis", "spine1", "spine2"}
    face = [name for name in SKELETONS["coco17"].names if name == "nose" or name.endswith("_surface")]
    assert seen("coco17", *face) == {"neck", "head", "jaw", "left_eye", "right_eye"}
    assert seen("coco17", *face[1:]) == set()


def test_points_outside_of_the_image_are_not_seen() -> None:
    assert seen("coco17", places={"left_knee": (50.0, 99.6)}) == {"left_knee"}
    assert seen("coco17", places={"left_knee": (-0.4, 99.4)}) == set()


def test_fingers_need_half_of_their_points() -> None:
    hand = list(SKELETONS["coco_wholebody133"].names[112:133])
    assert "right_index1" in seen("coco_wholebody133", *hand[:11])
    assert "right_wrist" not in seen("coco_wholebody133", *hand)
