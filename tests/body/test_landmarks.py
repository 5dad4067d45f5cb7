"""Landmarks: known sides, known neighbours, and the small model against the whole body."""

from __future__ import annotations

import pytest
import torch

from physic_core.body import JOINT_INDEX
from physic_core.errors import BodyModelError
from physic_core.types import SKELETONS, Skeleton

ON_BODY = (
    "coco17",
    "coco23",
    "blazepose33",
    "openpose_hand21_left",
    "openpose_hand21_right",
    "wholebody69",
)


@pytest.fixture(scope="module")
def at_rest(embedded):
    """Joint set -> name -> point in the T-pose."""
    output = embedded(*embedded.zero_pose())
    return {
        s: dict(zip(SKELETONS[s].names, embedded.landmarks(output, s)[0], strict=True))
        for s in ON_BODY
    }


PUBLISHED = {
    "blazepose33": {
        0: "nose",
        2: "left_eye_surface",
        5: "right_eye_surface",
        8: "right_ear_surface",
        11: "left_shoulder",
        16: "right_wrist",
        17: "left_pinky1",
        20: "right_index1",
        21: "left_thumb2",
        23: "left_hip",
        28: "right_ankle",
        29: "left_heel",
        32: "right_foot_tip",
    },
    # Face points are 300W's: eye corners 36 39 42 45 and mouth corners 48 54, the person's right
    # first.
    "coco_wholebody133": {
        **dict(enumerate(SKELETONS["coco23"].names)),
        23 + 36: "right_eye_outer_surface",
        23 + 39: "right_eye_inner_surface",
        23 + 45: "left_eye_outer_surface",
        23 + 48: "right_mouth_corner_surface",
        23 + 54: "left_mouth_corner_surface",
        23 + 30: "face_point_30",
        91: "left_hand_root",
        92: "left_thumb1",
        95: "left_thumb_tip",
        96: "left_index1",
        111: "left_pinky_tip",
        112: "right_hand_root",
        117: "right_index1",
        132: "right_pinky_tip",
    },
    "halpe26": {
        **dict(enumerate(SKELETONS["coco17"].names)),
        20: "left_big_toe",
        23: "right_small_toe",
        25: "right_heel",
    },
}


@pytest.mark.parametrize("skeleton", PUBLISHED)
def test_points_have_their_published_order(skeleton):
    points = SKELETONS[skeleton].names
    assert {i: points[i] for i in PUBLISHED[skeleton]} == PUBLISHED[skeleton]


@pytest.mark.parametrize("skeleton", ["coco23", "blazepose33", "wholebody69"])
def test_left_is_plus_x_in_the_t_pose(skeleton, at_rest):
    for name, point in at_rest[skeleton].items():
        if name.startswith("left_"):
            mirror = at_rest[skeleton]["right_" + name[5:]]
            assert point[0] > 0.01, name
            assert torch.allclose(point, mirror * torch.tensor([-1.0, 1.0, 1.0]), atol=3e-3), name


def test_landmarks_of_the_feet_lie_on_the_feet(embedded, at_rest):
    coco = at_rest["coco23"]
    mesh = embedded(*embedded.zero_pose()).vertices[0]
    for side, sign in (("left", 1), ("right", -1)):
        ankle, heel, big, small = (
            coco[f"{side}_{end}"] for end in ("ankle", "heel", "big_toe", "small_toe")
        )
        assert heel[2] < ankle[2] < small[2] < big[2]
        assert sign * small[0] > sign * big[0]
        assert max(heel[1], big[1], small[1]) < ankle[1] - 0.02
        tip = mesh[embedded.surface_points[f"{side}_foot_tip"]].mean(0)
        assert 0.2 < float(tip[2] - heel[2]) < 0.3


def test_points_of_ones_own_lie_by_their_shares_between_points_of_the_body(embedded, random_pose):
    output = embedded(**random_pose)
    own = Skeleton(
        "own",
        ("mid_thigh", "left_hip", "chin"),
        on_body={
            "mid_thigh": {"left_hip": 0.5, "left_knee": 0.5},
            "left_hip": {"left_knee": 0.06, "right_hip": 0.08},
            "chin": {"jaw": 0.3, "nose": 0.7},
        },
    )
    thigh, hip, chin = embedded.landmarks(output, own).unbind(1)
    left, right, knee, jaw = (
        output.joints[:, JOINT_INDEX[n]] for n in ("left_hip", "right_hip", "left_knee", "jaw")
    )
    nose = output.vertices[:, embedded.surface_points["nose"]].mean(1)
    assert torch.allclose(thigh, (left + knee) / 2, atol=1e-6)
    assert torch.allclose(hip, left + 0.06 * (knee - left) + 0.08 * (right - left), atol=1e-6)
    assert torch.allclose(chin, 0.3 * jaw + 0.7 * nose, atol=1e-6)


@pytest.mark.parametrize(
    ("names", "on_body", "fault"),
    [
        (("left_kne",), {}, "the point 'left_kne' of the skeleton 'own' is not a point of a body"),
        (("chin",), {"chin": {"jaw": 0.5}}, "sum to 0.5, not 1"),
        (
            ("chin",),
            {"chin": {"jow": 1.0}},
            "the point 'chin' of the skeleton 'own' refers to jow, which no body has",
        ),
    ],
)
def test_refuses_points_without_a_place(embedded, names, on_body, fault):
    with pytest.raises(BodyModelError, match=fault):
        embedded.regressor(Skeleton("own", names, on_body))


@pytest.mark.parametrize(
    ("fields", "fault"),
    [
        ({"names": ("nose", "nose")}, "names nose twice"),
        ({"names": ("nose",), "weights": {"chin": 1.0}}, "lacks chin"),
        ({"names": ("nose",), "weights": {"nose": -1.0}}, "weights of at least 0"),
        ({"names": ("nose",), "on_body": {"nose": {"jaw": float("nan")}}}, "finite shares"),
    ],
)
def test_a_skeleton_refuses_what_does_not_fit(fields, fault):
    with pytest.raises(ValueError, match=fault):
        Skeleton("own", **fields)


def test_hands_run_from_wrist_to_tips(at_rest):
    for side in ("left", "right"):
        wrist, *rest = at_rest[f"openpose_hand21_{side}"].values()
        fingers = torch.stack(rest).view(5, 4, 3)
        assert ((fingers - wrist).norm(dim=-1).diff(dim=1) > 0).all()
        tips = (fingers[:, 3] - fingers[:, 2]).norm(dim=-1)
        assert 0.01 < tips.min() <= tips.max() < 0.04
        assert (fingers[1:, 0, 2].diff() < 0).all()  # index in front, little finger behind


def test_refuses_an_unknown_joint_set(embedded):
    with pytest.raises(BodyModelError, match="'coco18': choose one of coco17, coco23"):
        embedded.landmarks_only(("coco18",))
