"""True contacts: which item, other person and own part a vertex touches, within the reach and for
outer skin alone.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.worlds.body_contacts import NONE, touched_item, touched_own_part, touched_people
from physic_testing.worlds.rooms import Room
from physic_testing.worlds.solids import LEVEL_GROUND, Block
from physic_testing.worlds.textures import Patch

from .float64_model import float64_model

if TYPE_CHECKING:
    from physic_core.types import FloatArray

REACH = 0.02


@lru_cache(maxsize=1)
def t_pose() -> FloatArray:
    vertices: FloatArray = float64_model()(*float64_model().zero_pose()).vertices[0].numpy()
    return vertices


def test_an_item_is_touched_within_the_reach_by_outer_vertices() -> None:
    ball, cup = (
        Block((x, 1.0, 0.0), (0.1, 0.1, 0.1), rounding=0.1, item=name)
        for x, name in ((0.0, "ball"), (1.0, "cup"))
    )
    table = Block((2.0, 0.4, 0.0), (0.3, 0.4, 0.3))
    room = Room(LEVEL_GROUND, (table, ball, cup), None, Patch("wood", 0))
    at = [
        (0.0, 1.115, 0.0),
        (0.0, 1.13, 0.0),
        (1.1, 1.0, 0.0),
        (2.0, 0.8, 0.0),
        (0.0, 1.0, 0.0),
        (0.0, 1.1, 0.0),
    ]
    outer = np.array([True] * 5 + [False])
    found = touched_item(room, outer, np.array([at]), REACH)
    assert room.items == ("ball", "cup")
    assert found.tolist() == [[0, NONE, 1, NONE, 0, NONE]]


def test_people_touch_each_other_and_no_one_far_away() -> None:
    body = t_pose()
    near = np.stack([body, body + np.array([0.0, 0.0, 0.2])])
    person = touched_people(float64_model(), near, REACH)
    assert set(person[0].tolist()) == {NONE, 1}
    assert set(person[1].tolist()) == {NONE, 0}
    assert not (person[:, ~float64_model().outer.numpy()] != NONE).any()
    person = touched_people(
        float64_model(), np.stack([body, body + np.array([0.0, 0.0, 3.0])]), REACH
    )
    assert (person == NONE).all()


def test_hands_and_feet_of_a_t_pose_touch_no_part_of_the_own_body() -> None:
    found = touched_own_part(float64_model(), t_pose()[None], REACH)[0]
    for name in ("left_hand", "right_hand", "left_sole", "right_sole"):
        assert (found[float64_model().contact_sets[name].numpy()] == NONE).all()
