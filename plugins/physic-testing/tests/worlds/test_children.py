"""Worlds with children: whose bodies they are, and what is stated about them."""

import numpy as np
import pytest
import torch

from physic_core.body import load_body
from physic_core.body.bones import rotations_from_parameters
from physic_testing.worlds import build_world


@pytest.fixture(scope="module")
def world():
    return build_world("child_by_the_hand", 1)


def test_an_adult_and_a_child_of_a_stated_age_stand_on_the_floor(world):
    model = load_body("embedded")
    adult, child = model.stature(torch.tensor(world.parameters.betas)).tolist()
    assert np.isnan(world.ages[0])
    assert 1 <= world.ages[1] <= 15
    assert adult > 1.45
    assert 0.7 < child < 1.85
    heights = world.vertices @ world.floor.normal + world.floor.offset
    assert np.abs(heights.min(1)).max() < 0.02


def test_child_and_adult_touch_each_other(world):
    assert (world.touched_person[0] == 1).any()
    assert (world.touched_person[1] == 0).any()


def test_the_child_has_a_body_near_the_shape_components_that_is_none_of_theirs(world):
    p = world.parameters
    posed = load_body("embedded")(
        rotations_from_parameters(p), torch.tensor(p.betas), torch.tensor(p.transl)
    ).vertices.numpy()
    adult, child = np.linalg.norm(posed - world.vertices, axis=-1)
    assert adult.max() < 1e-4
    assert 0.0004 < child.mean() < 0.005
    assert child.max() > 0.003


def test_people_of_other_worlds_have_no_age():
    assert np.isnan(build_world("stand", 0).ages).all()
