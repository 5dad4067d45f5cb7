"""Stage 2 alone: people are found again in a room with a known floor, and a wrong floor is
dropped.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from physic_core import engine_preset
from physic_core.engine.ground.stance import Stance
from physic_core.engine.joint.solve import optimize
from physic_core.engine.photo_content import PixelPoints
from physic_core.engine.placement.solve import solve_placement
from physic_core.engine.sizes.known_sizes import LocatedDistances, LocatedSizes, scale_scene
from physic_core.types import Observations
from physic_core.types.observations import POSTURES

from .conftest import CAMERA, FLOOR_Y
from .seen import pointmap_of
from .touching import touching

DEFAULT = engine_preset("default").placement
AWAY = torch.tensor([[0.1, 0.05, 0.4]])
RIDES = np.where(np.array(POSTURES) == "ride", 0.96, 0.005)[None]


def estimated_too_far(make_stage, stands_at):
    """A person in a room, estimated 40 cm too far away, and a photo with an unknown scale."""
    state = make_stage([({}, (0.3, 0.0, 3.0))], stands_at=stands_at).state
    depth = state.scene.points[..., 2]
    photo = torch.where(state.photo_depth.isnan(), depth, state.photo_depth)
    points = PixelPoints.of(pointmap_of(0.5 * photo.numpy(), CAMERA, "scale"))
    scene = replace(state.scene, diagnostics={"floor": {}})
    state = replace(state, transl=state.transl + AWAY, scene=scene)
    content = SimpleNamespace(photo_points=points, hole=state.masks.any(0))
    return SimpleNamespace(photo=content), state


@pytest.fixture(scope="module")
def given(make_stage):
    """One who stands on the floor."""
    return estimated_too_far(make_stage, FLOOR_Y)


def test_placement_recovers_the_true_place_of_a_person(given):
    estimates, state = given
    found = solve_placement(estimates, state, DEFAULT)
    error = (found.transl - (state.transl - AWAY)).norm()
    assert error < 0.03
    assert found.photo_alignment.scale == pytest.approx(2.0, rel=1e-3)
    assert found.scene is state.scene
    assert (found.size_ratio, found.limb_touch_probability) == (None, None)


def test_feet_on_pedals_do_not_draw_the_floor_to_them(make_stage):
    """A rider's soles are 25 cm over the ground, and the scene keeps its size."""
    estimates, state = estimated_too_far(make_stage, FLOOR_Y - 0.25)
    estimates.photo.observations = replace(Observations.unknown(1), posture=RIDES)
    said = touching(left_foot=("world", 0.99), right_foot=("world", 0.99), seat=("world", 0.99))
    touch = torch.tensor(replace(Stance.unknown(1), touch=said).limb_touch_probability)
    state = replace(state, limb_touch_probability=touch.to(state.transl))
    found = optimize(solve_placement(estimates, state, DEFAULT), engine_preset("default").joint)
    assert found.unapplied_scene_scale == pytest.approx(1.0, abs=0.03)
    lowest = float(found.vertices[..., 1].max())
    assert lowest == pytest.approx(FLOOR_Y - 0.25, abs=0.02)


@pytest.fixture
def known(given):
    """A known height of the camera, a tenth above the estimated one."""
    nothing = LocatedDistances(
        torch.zeros(0),
        torch.zeros(0, 2, dtype=torch.int64),
        torch.zeros(0, 2, 3),
        torch.zeros(0, 2, 3),
        torch.zeros(0, dtype=torch.int64),
    )
    return LocatedSizes(torch.tensor([torch.nan]), 1.1 * given[1].scene.floor.offset, nothing)


def test_people_are_resized_to_a_scene_of_known_size(given, known):
    estimates, state = given
    scene, geometry = scale_scene(state.scene, known, 1.1)
    found = solve_placement(estimates, replace(state, scene=scene, known=geometry), DEFAULT)
    before, after = (one.model.stature(one.betas) for one in (state, found))
    assert found.size_ratio.tolist() == pytest.approx([1.1], rel=0.02)
    assert 1.02 < float(after / before) < 1.1
