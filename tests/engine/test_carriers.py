"""People on bicycles and boards: found by boxes and keypoints, they touch what carries them."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core.engine.contact.method import ContactStageMethod
from physic_core.engine.contact.solve import find_contact
from physic_core.engine.ground.carriers import NOTHING, Carried, carried_people
from physic_core.types import SKELETONS, Carrier, Keypoints

from .test_contact_probability import alone, near_of
from .touching import LIMBS, touching

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


BICYCLE = carrier("bicycle", (100.0, 270.0), 160.0, 140.0)
UNSURE = carrier("bicycle", (110.0, 270.0), 160.0, 140.0, 0.5)
BEHIND = carrier("bicycle", (100.0, 180.0), 160.0, 60.0)  # ends at the hips


@pytest.mark.parametrize(
    ("carriers", "shift", "ridden"),
    [
        ([BICYCLE], 0.0, 0),
        ([BICYCLE], 140.0, NOTHING),
        ([BEHIND], 0.0, NOTHING),
        ([BICYCLE, UNSURE], 0.0, 0),
        ([UNSURE, BICYCLE], 0.0, 1),
    ],
)
def test_the_surest_bicycle_whose_box_holds_the_hips_is_ridden(carriers, shift, ridden):
    assert carried_people(carriers, person(shift)).ridden.tolist() == [ridden]


def test_a_board_carries_both_feet_and_not_only_one():
    keypoints = person()
    board = carrier("ski", FEET_PX, 140.0, 10.0)
    assert carried_people([board], keypoints).board.tolist() == [0]
    right = [NAMES.index(f"right_{end}") for end in ("ankle", "heel", "foot_tip")]
    keypoints.points[0, right, 0] -= 120.0
    assert carried_people([board], keypoints).board.tolist() == [NOTHING]


@pytest.mark.parametrize(
    ("name", "ridden", "board", "gap", "feet", "hands"),
    [
        ("ski", NOTHING, NOTHING, 0.0, "floor", None),
        ("ski", NOTHING, 0, 0.0, "floor", None),
        ("skateboard", NOTHING, 0, 0.08, "skateboard", None),
        ("bicycle", 0, NOTHING, 0.0, "floor", "bicycle"),
        ("bicycle", 0, NOTHING, 2.0, "bicycle", "bicycle"),
    ],
    ids=["beside", "on skis on the snow", "on a board", "stops", "rides what the scene lacks"],
)
def test_people_touch_what_carries_them(body, name, ridden, board, gap, feet, hands):
    """A person in the rest pose over a floor, by a gap; hands of people who ride are observed to
    touch something.
    """
    soles = float(body(*body.zero_pose()).vertices[..., 1].min())
    carried = Carried((name,), np.array([ridden]), np.array([board]))
    said = {} if ridden == NOTHING else dict.fromkeys(LIMBS, ("world", 0.98))
    observed = torch.tensor(touching(**said))
    floor = torch.tensor([0.0, 1.0, 0.0]), gap - soles
    state = alone(body, floor, carried=carried, observed_touch=observed)
    found = find_contact(state, near_of(state, ContactStageMethod()), ContactStageMethod())
    touched = {one.part: one.partner.title for one in found.contacts[0]}
    assert [touched.get(f"{side}_foot") for side in ("left", "right")] == [feet] * 2
    assert [touched.get(f"{side}_hand") for side in ("left", "right")] == [hands] * 2
    assert ("floor" in touched.values()) == (feet == "floor")
