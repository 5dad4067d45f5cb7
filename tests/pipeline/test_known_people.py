"""Children of known age: their stature, their shape, and what becomes of them in a result."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core import KnownSizes, load_config, load_reconstruction, reconstruct
from physic_core.body import load_body
from physic_core.body.bones import parameters_from_rotations
from physic_core.engine.sizes.stature import load_ages, resize_children
from physic_core.types import Bodies
from physic_core.types.known_sizes import KnownPeople
from physic_testing.worlds import load_world

NAN = np.nan


def test_statures_grow_with_age_and_shapes_have_the_stature():
    ages = load_ages()
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


UNSAID = np.full(2, NAN)


def test_people_who_seem_to_be_children_get_the_size_of_one_unless_their_size_is_known():
    said = np.array([0.2, 0.9])
    before = two_adults()
    unknown, grown = (
        resize_children(Bodies(before, "embedded"), load_body("embedded"), known, said)
        for known in (KnownPeople(), KnownPeople(years=np.array([NAN, 30.0])))
    )
    tall, small = stature(unknown[0].parameters)
    assert tall == pytest.approx(stature(before)[0])
    assert 1.0 < small < 1.4
    assert "person 1 seems to be a child" in unknown[1][0]
    assert stature(grown[0].parameters) == pytest.approx(stature(before))
    assert not grown[1]


def test_a_child_gets_a_childs_shape_and_stays_where_the_photo_shows_it():
    before = two_adults()
    known = KnownPeople(years=np.array([NAN, 4.5]))
    found, notes = resize_children(Bodies(before, "embedded"), load_body("embedded"), known, UNSAID)
    after = found.parameters
    assert np.array_equal(after.betas[0], before.betas[0])
    assert np.array_equal(after.transl[0], before.transl[0])
    usual = np.exp(load_ages().at_age(4.5)[0])
    assert stature(after)[1] == pytest.approx(usual, abs=1e-3)
    assert after.transl[1] == pytest.approx(before.transl[1] * usual / stature(before)[1], rel=1e-3)
    assert np.abs(after.betas[1] - before.betas[1]).max() > 1
    assert notes == ["person 1 is a child of 4.5 years, 1.05 m ± 5 % tall before the joint fit"]


def test_a_known_stature_counts_more_than_an_age():
    known = KnownPeople(years=np.array([4.5, 4.5]), stature=np.array([0.95, NAN]))
    found, notes = resize_children(
        Bodies(two_adults(), "embedded"), load_body("embedded"), known, UNSAID
    )
    assert stature(found.parameters) == pytest.approx(
        [0.95, np.exp(load_ages().at_age(4.5)[0])], abs=1e-3
    )
    assert notes[0] == "person 0 is a child of 4.5 years, 0.95 m tall before the joint fit"


def test_adults_and_people_without_a_body_keep_what_they_have():
    before = two_adults()
    before.betas[1] = NAN
    known = KnownPeople(years=np.array([16.0, 4.5]))
    found, notes = resize_children(Bodies(before, "embedded"), load_body("embedded"), known, UNSAID)
    assert np.array_equal(found.parameters.betas, before.betas, equal_nan=True)
    assert np.array_equal(found.parameters.transl, before.transl)
    assert not notes


def place_of_child(world):
    """Count people from the left up to the child."""
    order = np.argsort(world.boxes[:, 0] + world.boxes[:, 2])
    return int(np.isfinite(world.ages[order]).argmax())


@pytest.mark.parametrize("who", ["child", "adult"])
def test_the_age_of_a_child_is_contradicted_by_the_adult_beside_it(who):
    world = load_world("child_by_the_hand", (160, 120))
    child = place_of_child(world)
    chosen = child if who == "child" else 1 - child
    given = [0.0, 0.0]
    given[chosen] = float(np.nanmax(world.ages))  # four years
    quick = ("run.cache=false", "engine.joint.optimiser.steps=20")
    config = load_config(preset="mock", overrides=quick)
    result = reconstruct(world.image, config, known=KnownSizes(age=tuple(given)))
    (check,) = (check for check in result.checks if check.name == "given_size")
    assert result.people[check.person].age == given[chosen]
    assert check.failed == (who == "adult")
    if check.failed:
        assert f"is usual at {given[chosen]:g} years" in check.message
        assert result.people[check.person].grade in ("doubtful", "bad")
        assert any(warning.endswith(check.message) for warning in result.warnings)


def test_a_given_age_gives_the_stature_and_is_in_the_saved_result(tmp_path):
    world = load_world("child_by_the_hand_view1", (160, 120))
    child = place_of_child(world)
    given = [0.0, 0.0]
    given[child] = 4.0
    quick = load_config(
        preset="mock", overrides=("run.cache=false", "engine.joint.optimiser.steps=5")
    )
    result = reconstruct(world.image, quick, known=KnownSizes(age=tuple(given)))
    people = sorted(result.people, key=lambda one: one.box[0] + one.box[2])
    assert [person.age for person in people] == [years or None for years in given]
    (found,) = stature(people[child].parameters)
    assert found == pytest.approx(np.exp(load_ages().at_age(4.0)[0]), rel=0.12)
    assert any("is a child of 4 years" in note for note in result.notes)
    result.save(str(tmp_path / "out"), "numbers")
    assert [one.age for one in load_reconstruction(str(tmp_path / "out")).people] == [
        one.age for one in result.people
    ]
