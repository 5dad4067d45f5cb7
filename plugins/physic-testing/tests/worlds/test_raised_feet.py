"""Worlds whose people have feet over the ground: poses, heights and contact."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.body import load_body
from physic_testing.worlds import RAISED_FEET_WORLDS, build_world

_IN_AIR = {"jump": 2, "raise_foot": 1, "vault": 2, "hold_bar": 2, "sit_high": 2}


@pytest.mark.parametrize("name", RAISED_FEET_WORLDS)
def test_feet_are_5_to_50_cm_over_the_ground_and_touch_nothing(name: str) -> None:
    world = build_world(name, 1, (160, 120))
    model = load_body()
    in_room = world.camera.to_room(world.vertices.astype(float))[0]
    in_air = 0
    for side in ("left", "right"):
        foot = (model.part_of_vertex == model.part_names.index(f"{side}_foot")).numpy()
        raised = in_room[foot, 1].min() > 0.03
        in_air += raised
        assert raised == (not world.contact[0, foot].any())
        assert in_room[foot, 1].min() < 0.5
    assert in_air == _IN_AIR[name]
    assert world.contact.any() == (name != "jump")
    assert np.isfinite(world.distance).all()
