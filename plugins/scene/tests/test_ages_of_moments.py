"""The age of a person of one photo is that of the person in the result."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core import KnownSizes, load_config
from physic_core.body import load_body
from physic_core.engine.sizes.stature import load_child_growth
from physic_core.errors import ConfigError, InputError
from physic_core.interfaces import INTERFACES
from physic_scene import ScenePipeline
from physic_testing.worlds import load_world

NOISE = {name: {"options": {"noise": 0.25}} for name in INTERFACES}
QUICK = ("engine.joint.optimiser.steps=5",)
YEARS = 10.0


@pytest.fixture(scope="module")
def worlds():
    return [load_world(f"child_by_the_hand_view{i}", (160, 120)) for i in (1, 2)]


@pytest.fixture(scope="module")
def solver():
    with ScenePipeline(
        load_config(preset="mock", flags={"noise": NOISE}, overrides=QUICK)
    ) as scene:
        yield scene


def ages_of(world):
    """Return the ages of the people of a photo, from left to right, of which the adult's is
    unknown.
    """
    is_child = np.isfinite(world.ages[np.argsort(world.boxes[:, 0] + world.boxes[:, 2])])
    return tuple(np.where(is_child, YEARS, 0.0).tolist())


@pytest.fixture(scope="module")
def alone(solver, worlds):
    return [
        solver.reconstruct_photo(world.image, known=KnownSizes(age=ages_of(world)))
        for world in worlds
    ]


def test_the_age_of_a_person_in_each_photo_is_that_of_the_result(solver, alone):
    found = solver.join_photos(alone)
    child, other = sorted(found.reconstruction.people, key=lambda person: person.age != YEARS)
    assert (child.age, other.age) == (YEARS, None)
    model = load_body("embedded")
    stature = [float(model.stature(torch.tensor(one.parameters.betas))) for one in (child, other)]
    assert stature[0] == pytest.approx(np.exp(load_child_growth().at_age(YEARS)[0]), rel=0.12)
    assert stature[1] > 1.5
    assert any("is a child of 10 years" in note for note in found.reconstruction.notes)


def test_several_ages_are_those_of_one_photo(solver, worlds):
    with pytest.raises(ConfigError, match="one age"):
        solver([world.image for world in worlds], known=KnownSizes(age=(38, 5)))


def test_statures_of_a_photo_that_is_left_out_are_refused(solver, alone):
    with pytest.raises(InputError, match="of the first photo, but photo 1 is skipped"):
        solver.join_photos([None, *alone], statures=(1.8, 0.0))
