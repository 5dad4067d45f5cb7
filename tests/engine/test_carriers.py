"""People on bicycles and boards: found by boxes and keypoints, they touch what carries them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core.engine.carriers import NOTHING, Carried, carried_people
from physic_core.engine.contact.method import ContactMethod
from physic_core.engine.contact.solve import contact_of
from physic_core.engine.stance import Stance
from physic_core.types import SKELETONS, Carrier, Keypoints

from .test_contact_probability import alone, near_of

HIPS_PX = (100.0, 200.0)
FEET_PX = (100.0, 300.0)
NAMES = SKELETONS["blazepose33"].names


def person(shift=0.0):
    """Keypoints of a person with a trunk of 100 px, and the feet 100 px below the hips."""
    points = np.full((1, 33, 2), np.nan)
    for name, y in {"shoulder": 100.0, "hip": 200.0, "ankle": 296.0, "heel": 300.0}.items():
        for side, x in (("left", 110.0), ("right", 90.0)):
            points[0, NAMES.index(f"{side}_{name}")] = x + shift, y
    for side, x in (("left", 115.0), ("right", 95.0)):
        points[0, NAMES.index(f"{side}_foot_tip")] = x + shift, 302.0
    return Keypoints(points, np.ones((1, 33)), "blazepose33")


def carrier(name, center, width, height, score=0.8):
    x, y = center
    box = (x - width / 2, y - height / 2, x + width / 2, y + height / 2)
    return Carrier(name, box, score)


def test_a_person_whose_hips_are_over_a_bicycle_rides_it():
    bicycle = carrier("bicycle", (100.0, 270.0), 160.0, 140.0)
    assert carried_people([bicycle], person()).ridden.tolist() == [0]
    assert carried_people([bicycle], person(shift=140.0)).ridden.tolist() == [NOTHING]


def test_a_person_in_front_of_a_bicycle_that_ends_at_the_hips_does_not_ride_it():
    behind = carrier("bicycle", (100.0, 180.0), 160.0, 60.0)
    assert not carried_people([behind], person()).rides.any()


def test_a_board_carries_both_feet_and_not_only_one():
    keypoints = person()
    board = carrier("ski", FEET_PX, 140.0, 10.0)
    assert carried_people([board], keypoints).board.tolist() == [0]
    right = [NAMES.index(f"right_{end}") for end in ("ankle", "heel", "foot_tip")]
    keypoints.points[0, right, 0] -= 120.0
    assert carried_people([board], keypoints).board.tolist() == [NOTHING]


def test_of_two_bicycles_the_surer_one_is_ridden_in_any_order():
    sure = carrier("bicycle", (100.0, 270.0), 160.0, 140.0, 0.9)
    unsure = carrier("bicycle", (110.0, 270.0), 160.0, 140.0, 0.5)
    assert carried_people([sure, unsure], person()).ridden.tolist() == [0]
    assert carried_people([unsure, sure], person()).ridden.tolist() == [1]


def test_without_keypoints_of_the_hips_nothing_is_ridden():
    unknown = Keypoints(np.full((1, 33, 2), np.nan), np.zeros((1, 33)), "blazepose33")
    bicycle = carrier("bicycle", HIPS_PX, 400.0, 400.0)
    board = carrier("ski", FEET_PX, 400.0, 400.0)
    found = carried_people([bicycle, board], unknown)
    assert (found.ridden.tolist(), found.board.tolist()) == ([NOTHING], [NOTHING])


@pytest.fixture
def standing(body):
    """Contact of a person in the rest pose on a floor, with what carries the person."""
    soles = float(body(*body.zero_pose()).vertices[..., 1].min())

    def contact(carried, gap=0.0):
        stance = replace(Stance.unknown(1), carried=carried)
        state = alone(body, (torch.tensor([0.0, 1.0, 0.0]), gap - soles), stance)
        return contact_of(state, near_of(state, ContactMethod()), ContactMethod())

    return contact


def touched(contact):
    return {one.part: one.partner.title for one in contact.contacts[0]}


def test_feet_on_a_board_touch_the_board_and_not_the_floor(standing):
    alone_on_floor = touched(standing(None))
    on_board = touched(standing(Carried(("ski",), np.array([NOTHING]), np.array([0]))))
    assert alone_on_floor["left_foot"] == alone_on_floor["right_foot"] == "floor"
    assert on_board["left_foot"] == on_board["right_foot"] == "ski"
    assert on_board.keys() == alone_on_floor.keys()


def test_feet_hands_and_seat_of_a_person_who_rides_touch_what_is_ridden(standing):
    riding = touched(standing(Carried(("bicycle",), np.array([0]), np.array([NOTHING]))))
    parts = ("left_foot", "right_foot", "left_hand", "right_hand")
    assert {riding.get(part) for part in parts} == {"bicycle"}
    assert "floor" not in riding.values()


def test_a_bicycle_that_the_scene_lacks_carries_all_the_same(standing):
    far_below = standing(Carried(("bicycle",), np.array([0]), np.array([NOTHING])), gap=2.0)
    assert touched(far_below)["left_foot"] == "bicycle"


def test_another_person_keeps_the_floor_beside_a_bicycle(standing):
    beside = standing(Carried(("bicycle",), np.array([NOTHING]), np.array([NOTHING])))
    assert touched(beside)["left_foot"] == "floor"
