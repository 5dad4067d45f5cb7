"""An age belongs to a person of the first photo, holds in all photos, and is in the result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from PIL import Image

from physic_core import KnownSizes, load_config
from physic_core.body import load_body
from physic_core.body.ages import load_ages
from physic_core.errors import InputError
from physic_core.interfaces import INTERFACES
from physic_scene import ScenePipeline
from physic_scene.command import scene as command
from physic_testing.worlds import build_world, view_names

NOISE = {name: {"options": {"noise": 0.25}} for name in INTERFACES}
QUICK = ("engine.joint.optimiser.steps=5",)
YEARS = 10.0


@pytest.fixture(scope="module")
def worlds():
    return [build_world(name, 1, (160, 120)) for name in view_names("child_by_the_hand", 2)]


@pytest.fixture(scope="module")
def solver():
    with ScenePipeline(load_config(preset="mock", flags={"noise": NOISE}, overrides=QUICK)) as scene:
        yield scene


@pytest.fixture(scope="module")
def ages(worlds):
    """Return the ages in the first photo, from left to right, of which the adult's is unknown."""
    boxes = worlds[0].boxes
    is_child = np.isfinite(worlds[0].ages[np.argsort(boxes[:, 0] + boxes[:, 2])])
    return tuple(np.where(is_child, YEARS, 0.0).tolist())


@pytest.fixture(scope="module")
def alone(solver, worlds):
    return [solver.alone(world.image) for world in worlds]


def test_an_age_holds_in_all_photos_and_is_in_the_result(solver, worlds, ages):
    found = solver([world.image for world in worlds], known=KnownSizes(age=ages))
    (child,) = (row for row, person in enumerate(found.reconstruction.people) if person.age == YEARS)
    person, (other,) = (
        found.reconstruction.people[child],
        (one for row, one in enumerate(found.reconstruction.people) if row != child),
    )
    assert other.age is None
    model = load_body("embedded")
    stature = [float(model.stature(torch.tensor(one.parameters.betas))) for one in (person, other)]
    assert stature[0] == pytest.approx(np.exp(load_ages().at_age(YEARS)[0]), rel=0.12)
    assert stature[1] > 1.5
    for photo in found.photos:
        (own,) = (i for i, one in enumerate(photo.result.people) if one.age == YEARS)
        assert photo.people[own] == next(i for i, one in enumerate(found.people) if one.row == child)
    assert any(note.startswith(f"person {child} is a child of 10 years") for note in found.reconstruction.notes)


def test_ages_are_as_many_as_the_people_of_the_first_photo(solver, worlds):
    message = (
        "3 ages were given, but 2 people were found in photo 1, the first photo: give one age for all, or one per "
        "person of it from left to right with 0 where it is unknown"
    )
    with pytest.raises(InputError) as error:
        solver([world.image for world in worlds], known=KnownSizes(age=(38, 5, 7)))
    assert str(error.value) == message


def test_statures_of_a_photo_that_is_left_out_are_refused(solver, alone):
    with pytest.raises(InputError) as error:
        solver.join([replace(alone[0], people=()), *alone], statures=(1.8, 0.0))
    assert str(error.value) == (
        "the statures are those of people of the first photo, but photo 1 is skipped: no person in it has a body; put "
        "another photo first"
    )


def of_age(result, years):
    """Return the result of a photo whose people were all given an age."""
    return replace(result, people=tuple(replace(person, age=years) for person in result.people))


def test_one_person_has_one_age(solver, alone):
    with pytest.raises(InputError) as error:
        solver.join([of_age(alone[0], 4.0), of_age(alone[1], 5.5)], ["a.png", "b.png"])
    assert str(error.value) == "one person was given different ages, in years: 4 in a.png, 5.5 in b.png; correct them"


@pytest.mark.parametrize(
    ("age", "message"),
    [
        ("old", "--age old: give numbers with commas between them"),
        ("38,-1", "an age should be 0 to 120 years, 0 where unknown (got -1)"),
    ],
)
def test_the_command_names_a_wrong_age(worlds, tmp_path, age, message):
    for name, world in zip("ab", worlds, strict=True):
        Image.fromarray(world.image).save(tmp_path / f"{name}.png")
    photos = [str(tmp_path / f"{name}.png") for name in "ab"]
    run = CliRunner().invoke(command, [*photos, "-o", str(tmp_path / "out"), "--age", age])
    assert message in f"{run.output}{run.exception}"
