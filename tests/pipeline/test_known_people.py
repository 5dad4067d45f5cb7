"""Children of known age: their stature, their shape, and what becomes of them in a result."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core import KnownSizes, load_reconstruction
from physic_core.body import load_body
from physic_core.body.bones import parameters_from_rotations
from physic_core.engine.sizes.stature import load_child_growth, resize_children
from physic_core.types import Bodies
from physic_core.types.known_sizes import KnownPeople
from physic_testing.worlds import load_world
from tests.pipeline.mocks import run

NAN = np.nan


def test_statures_grow_with_age_and_shapes_have_the_stature():
    ages = load_child_growth()
    model = load_body("embedded")
    assert (np.diff(ages.log_stature) > 0).all()
    shown = model.stature(torch.tensor(ages.betas(ages.log_stature)).float()).log().numpy()
    assert np.abs(shown - ages.log_stature).max() < 0.02
    assert np.exp(ages.at_age(7.5)[0]) == pytest.approx(1.25, abs=0.03)


def two_adults():
    """Bodies beside each other, 3 m and 5 m away, whose head is towards +y."""
    rotations, betas, _ = load_body("embedded").zero_pose(2)
    return parameters_from_rotations(
        rotations, betas, None, torch.tensor([[0.0, 0.1, 3.0], [0.5, 0.2, 5.0]])
    )


def stature(parameters):
    return load_body("embedded").stature(torch.tensor(parameters.betas)).tolist()


def resized(bodies, said=(NAN, NAN), **known):
    """Bodies with what is known of them, and notes."""
    given = KnownPeople(**{name: np.array(values) for name, values in known.items()})
    found, notes = resize_children(
        Bodies(bodies, "embedded"), load_body("embedded"), given, np.array(said)
    )
    return found.parameters, notes


def test_people_who_seem_to_be_children_get_the_size_of_one_unless_their_size_is_known():
    said = (0.2, 0.9)
    before = two_adults()
    after, notes = resized(before, said)
    tall, small = stature(after)
    assert tall == pytest.approx(stature(before)[0])
    assert 1.0 < small < 1.4
    assert "person 1 is probably a child" in notes[0]
    grown, notes = resized(before, said, years=[NAN, 30.0])
    assert stature(grown) == pytest.approx(stature(before))
    assert not notes


def test_a_child_gets_a_childs_shape_and_stays_where_the_photo_shows_it():
    before = two_adults()
    after, notes = resized(before, years=[NAN, 4.5])
    assert np.array_equal(after.betas[0], before.betas[0])
    assert np.array_equal(after.transl[0], before.transl[0])
    usual = np.exp(load_child_growth().at_age(4.5)[0])
    assert stature(after)[1] == pytest.approx(usual, abs=1e-3)
    assert after.transl[1] == pytest.approx(before.transl[1] * usual / stature(before)[1], rel=1e-3)
    assert np.abs(after.betas[1] - before.betas[1]).max() > 1
    assert notes == ["person 1 is a child of 4.5 years, 1.05 m ± 5 % tall before the joint fit"]


def test_a_known_stature_counts_more_than_an_age():
    after, notes = resized(two_adults(), years=[4.5, 4.5], stature=[0.95, NAN])
    assert stature(after) == pytest.approx(
        [0.95, np.exp(load_child_growth().at_age(4.5)[0])], abs=1e-3
    )
    assert notes[0] == "person 0 is a child of 4.5 years, 0.95 m tall before the joint fit"


def with_age(world, steps, chosen="child"):
    """The result of two people of whom the child, or the adult, is said to be four years old; also
    the ages, from left to right.
    """
    order = np.argsort(world.boxes[:, 0] + world.boxes[:, 2])
    is_given = np.isfinite(world.ages[order]) == (chosen == "child")
    ages = tuple(np.where(is_given, 4.0, 0.0).tolist())
    known = KnownSizes(age=ages)
    return run(world.image, f"engine.joint.optimiser.steps={steps}", known=known), ages


@pytest.mark.parametrize("who", ["child", "adult"])
def test_the_age_of_a_child_is_contradicted_by_the_adult_beside_it(who):
    result, ages = with_age(load_world("child_by_the_hand", (160, 120)), 20, who)
    (check,) = (check for check in result.checks if check.name == "given_size")
    assert result.people[check.person].age == ages[check.person] == 4
    assert check.failed == (who == "adult")
    if check.failed:
        assert "is usual at 4 years" in check.message
        assert not {"place", "size"} & {*result.people[check.person].usable}
        assert any(warning.endswith(check.message) for warning in result.warnings)


def test_a_given_age_gives_the_stature_and_is_in_the_saved_result(tmp_path):
    result, ages = with_age(load_world("child_by_the_hand_view1", (160, 120)), 5)
    assert [person.age for person in result.people] == [years or None for years in ages]
    (found,) = stature(result.people[ages.index(4)].parameters)
    assert found == pytest.approx(np.exp(load_child_growth().at_age(4.0)[0]), rel=0.12)
    assert any("is a child of 4 years" in note for note in result.notes)
    result.save(str(tmp_path / "out"), "numbers")
    assert [one.age for one in load_reconstruction(str(tmp_path / "out")).people] == [
        one.age for one in result.people
    ]
