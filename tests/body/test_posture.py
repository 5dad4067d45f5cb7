"""Which legs a body stands on."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.body.joints import JOINT_INDEX
from physic_core.body.posture import (
    lean_deg,
    photo_seems_turned,
    standing_legs,
)
from physic_core.types import Plane

UP = np.array([0.0, -1.0, 0.0])
AWAY = np.array([0.0, 1.5, 4.0])


def turned(degrees):
    """Return UP after a rotation about the x axis."""
    c = np.cos(np.radians(degrees))
    s = np.sin(np.radians(degrees))
    return np.array([0.0, -c, s])


def body(hip=0.0, knees=(0.0, 0.0), trunk=0.0):
    """Return joints (55, 3) of a body: trunk and thighs tilted from UP, shanks from the thighs,
    degrees.
    """
    joints = np.full((55, 3), np.nan)
    joints[JOINT_INDEX["pelvis"]] = 0.0
    joints[JOINT_INDEX["neck"]] = 0.5 * turned(trunk)
    for side, x, knee in (("left", 0.1, knees[0]), ("right", -0.1, knees[1])):
        place = np.array([x, 0.0, 0.0])
        ends = [place, place - 0.4 * turned(hip)]
        ends.append(ends[1] - 0.4 * turned(hip + knee))
        joints[[JOINT_INDEX[f"{side}_{name}"] for name in ("hip", "knee", "ankle")]] = ends
    return joints


@pytest.mark.parametrize(
    ("joints", "up", "stands"),
    [
        (np.stack([body(), body(hip=90.0)]), UP, [[True, True], [False, False]]),
        (body(knees=(60.0, 0.0)), UP, [False, True]),
        (body(), turned(90.0), [False, False]),
        (body(), None, [True, True]),
        (body(trunk=80.0), UP, [False, False]),
    ],
    ids=["two", "a bent knee", "lies", "up is unknown", "bows"],
)
def test_legs_stand_if_they_are_straight_and_upright_as_the_trunk(joints, up, stands):
    assert standing_legs(joints, up).tolist() == stands


@pytest.mark.parametrize(("tilt", "lean"), [(20.0, -20.0), (-20.0, 20.0), (120.0, -60.0)])
def test_a_body_leans_by_its_part_towards_the_camera(tilt, lean):
    joints = body(trunk=tilt) + AWAY
    assert lean_deg(joints, Plane(UP, 1.5), "trunk") == pytest.approx(lean)


def test_a_body_that_lies_across_the_picture_does_not_lean():
    joints = body()[:, [1, 0, 2]] + [-0.15, 1.5, 4.0]  # its middle is before the camera
    assert lean_deg(joints, Plane(UP, 1.5)) == pytest.approx(0.0, abs=1e-6)


def test_legs_with_unknown_joints_do_not_stand():
    joints = body()
    joints[JOINT_INDEX["left_knee"]] = np.nan
    assert standing_legs(joints, UP).tolist() == [False, True]


def photo_of(*bodies, degrees):
    """Return joints (P, 55, 3), side by side 5 m away, in a picture that is turned clockwise."""
    c = np.cos(np.radians(degrees))
    s = np.sin(np.radians(degrees))
    places = np.array([[x, 0.0, 5.0] for x in range(len(bodies))])[:, None]
    return (np.stack(bodies) + places) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T


@pytest.mark.parametrize("degrees", [0, 30, 90, -90, 75, 180, 150])
def test_a_turned_photo_is_known_by_its_people(degrees):
    found = photo_seems_turned(photo_of(body(), body(), degrees=degrees), None)
    assert found == (abs(degrees) > 30)


def test_a_photo_is_not_turned_if_one_person_is_upright_or_nobody_has_a_body():
    joints = np.concatenate([photo_of(body(), degrees=180), photo_of(body(), degrees=0)])
    assert not photo_seems_turned(joints, None)
    assert not photo_seems_turned(np.full((1, 55, 3), np.nan), None)
    assert not photo_seems_turned(np.zeros((0, 55, 3)), None)


def test_people_who_lie_or_bend_are_in_no_turned_photo():
    lying = photo_of(body(), degrees=90)
    assert not photo_seems_turned(lying, Plane((0.0, -1.0, 0.0), 1.0))
    assert photo_seems_turned(lying, Plane((1.0, 0.0, 0.0), 1.0))
    bent = photo_of(body(hip=80.0, knees=(80.0, 80.0)), degrees=90)
    assert not photo_seems_turned(bent, None)
    head_to_head = np.concatenate([lying, photo_of(body(), degrees=-90)])
    assert not photo_seems_turned(head_to_head, None)
