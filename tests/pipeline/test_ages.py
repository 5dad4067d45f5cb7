"""Who is taken for a child, how old and how tall, and what becomes of their bodies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core import KnownSizes, load_config, load_reconstruction, reconstruct
from physic_core.body import load_body
from physic_core.body.ages import load_ages
from physic_core.body.joints import joint_pair
from physic_core.pipeline.ages import AgeEvidence, AgeSettings, age_evidence, estimate_ages, resize_children
from physic_core.types import AgeEstimate, AgeEstimates, Bodies, BodyParameters, Hints, People, Plane, Pointmap
from physic_testing.worlds import build_world

NAN = np.nan


def evidence(*by_floor, stature=1.7, by_points=None, floor_height=1.4):
    """People whose estimated bodies ask for these scales of a scene, whose true scale is 1."""
    count = len(by_floor)
    return AgeEvidence(
        stature=np.full(count, stature),
        depth=np.full(count, 3.0),
        by_floor=np.log(by_floor),
        by_points=np.full(count, NAN) if by_points is None else np.log(by_points),
        floor_height=floor_height,
    )


def estimated(shown, years=None, stature=None, child_share=0.1):
    count = len(shown.stature)
    return estimate_ages(
        shown,
        AgeSettings(child_share),
        np.full(count, NAN) if years is None else np.array(years, float),
        np.full(count, NAN) if stature is None else np.array(stature, float),
    )


def test_statures_grow_with_age_and_shapes_have_the_stature():
    ages, model = load_ages(), load_body("embedded")
    assert (np.diff(ages.log_stature) > 0).all()
    assert ages.share.sum() == pytest.approx(1)
    shown = model.stature(torch.tensor(ages.betas(ages.log_stature)).float()).log().numpy()
    assert np.abs(shown - ages.log_stature).max() < 0.02
    assert np.exp(ages.at_age(7.5)[0]) == pytest.approx(1.25, abs=0.03)


def test_beside_adults_a_person_who_looks_half_as_large_is_a_child_of_that_stature():
    found = estimated(evidence(1.0, 1.0, 1.7, by_points=(1.0, 1.0, 1.7)))
    assert (found.child_probability[:2] < 0.1).all()
    assert np.isnan(found.stature[:2]).all()
    assert found.child_probability[2] > 0.95
    assert found.stature[2] == pytest.approx(1.0, rel=0.07)
    assert 2 < found.years[2] < 6
    assert 0.5 < found.years_sigma[2] < 2.5
    assert 0.04 < found.stature_sigma[2] < 0.15


def test_people_of_like_size_are_adults():
    assert (estimated(evidence(1.0, 1.0, 1.0)).child_probability < 0.05).all()
    assert (estimated(evidence(1.0, 1.1, 1 / 1.1)).child_probability < 0.15).all()


def test_feet_that_are_not_on_the_floor_do_not_make_a_child():
    on_chair = estimated(evidence(1.0, 0.5, by_points=(1.0, 1.0)))
    assert (on_chair.child_probability < 0.1).all()


def test_without_anything_measured_people_are_adults_as_often_as_stated():
    nothing = estimated(evidence(NAN, floor_height=None), child_share=0.2)
    assert nothing.child_probability[0] == pytest.approx(0.2)
    assert np.isnan(nothing.years[0])


def test_a_child_of_known_age_has_the_stature_of_that_age_and_gives_the_scale():
    found = estimated(evidence(1.7, 1.7), years=(NAN, 4.5))
    assert found.child_probability[1] == pytest.approx(1)
    assert (found.years[1], found.years_sigma[1]) == (4.5, 0)
    assert found.stature[1] == pytest.approx(np.exp(load_ages().at_age(4.5)[0]), rel=0.1)
    alone = estimated(evidence(NAN, floor_height=None), years=(4.5,))
    assert np.log(alone.stature[0]) == pytest.approx(load_ages().at_age(4.5)[0], abs=1e-3)


def test_a_child_of_known_age_and_stature_keeps_the_stature():
    found = estimated(evidence(1.0, stature=0.95), years=(4.5,), stature=(0.95,))
    assert found.stature[0] == pytest.approx(0.95, rel=0.01)
    assert found.years[0] == 4.5


def test_a_person_of_known_adult_age_or_stature_is_no_child():
    assert estimated(evidence(1.0, 1.7), years=(NAN, 40)).child_probability[1] == pytest.approx(0)
    assert estimated(evidence(1.0, 1.7), stature=(NAN, 1.7)).child_probability[1] == pytest.approx(0)


def test_a_known_camera_height_tells_a_child_alone():
    shown = evidence(1.7)
    unknown = AgeSettings(child_share=0.1)
    nothing = np.full(1, NAN)
    assert estimate_ages(shown, unknown, nothing, nothing).child_probability[0] < 0.5
    found = estimate_ages(shown, unknown, nothing, nothing, camera_height_m=1.4)
    assert found.child_probability[0] > 0.5
    assert found.stature[0] == pytest.approx(1.0, rel=0.15)


def test_only_children_make_the_scale_a_guess():
    alone = estimated(evidence(1.0), child_share=0.9)
    guessed = replace(alone, years=np.array([5.0]), years_sigma=np.array([2.0]), stature_sigma=np.array([0.2]))
    assert guessed.scale_guess() == (
        "the scale is a guess, since the photo shows only children: statures are uncertain by 20 %; give an age, a "
        "stature or the camera height"
    )
    assert replace(guessed, years_sigma=np.zeros(1)).scale_guess() == ""
    assert estimated(evidence(1.0, 1.7)).scale_guess() == ""


def two_adults():
    """Bodies beside each other, 3 m and 5 m away, whose head is towards +y."""
    sizes = {
        "global_orient": 3,
        "body_pose": 63,
        "left_hand_pose": 45,
        "right_hand_pose": 45,
        "jaw_pose": 3,
        "leye_pose": 3,
        "reye_pose": 3,
        "betas": 16,
        "expression": 0,
    }
    return BodyParameters(
        **{name: np.zeros((2, size), np.float32) for name, size in sizes.items()},
        transl=np.array([[0.0, 0.1, 3.0], [0.5, 0.2, 5.0]], np.float32),
    )


def test_a_person_without_a_leg_in_sight_shows_no_size():
    masks = np.zeros((2, 4, 6), bool)
    masks[0, :, :3] = masks[1, :, 3:] = True
    seen = np.ones((2, 55), bool)
    seen[1, [*joint_pair("knee"), *joint_pair("ankle")]] = False
    people = People(masks, np.array([[0, 0, 3, 4], [3, 0, 6, 4]], np.float32), np.ones(2, np.float32))
    points = Pointmap(np.full((4, 6, 3), 2.0, np.float32), np.ones((4, 6), bool), "scale")
    shown = age_evidence(
        Bodies(two_adults(), "embedded", observed=seen),
        load_body("embedded"),
        Hints(people=people, original=points, floor=Plane(np.array([0.0, 1.0, 0.0]), 1.0)),
    )
    assert np.exp(shown.by_points[0]) == pytest.approx(1.5, rel=0.05)
    assert np.isfinite(shown.by_floor[0])
    assert np.isnan([shown.by_points[1], shown.by_floor[1]]).all()


def test_a_child_gets_a_childs_shape_and_stays_where_the_photo_shows_it():
    model, zero = load_body("embedded"), two_adults()
    values = {name: np.array([NAN, value]) for name, value in (("years", 3.5), ("years_sigma", 1.0), ("stature", 1.0))}
    ages = AgeEstimates(child_probability=np.array([0.0, 1.0]), stature_sigma=np.array([0.06, 0.1]), **values)
    found = resize_children(Bodies(zero, "embedded"), model, ages)
    p = found.parameters
    assert np.array_equal(p.betas[0], zero.betas[0])
    assert np.array_equal(p.transl[0], zero.transl[0])
    adult, child = model.stature(torch.tensor(np.stack([zero.betas[0], p.betas[1]]))).tolist()
    assert child == pytest.approx(1.0, abs=1e-3)
    assert p.transl[1] == pytest.approx(zero.transl[1] * child / adult, rel=1e-3)
    assert np.array_equal(found.stature_sigma, ages.stature_sigma)


def test_a_given_age_gives_the_stature_and_is_in_the_saved_result(tmp_path):
    world = build_world("child_by_the_hand", 1, (160, 120))
    order = np.argsort(world.boxes[:, 0] + world.boxes[:, 2])
    child = int(np.isfinite(world.ages[order]).argmax())
    given = [0.0, 0.0]
    given[child] = 4.0
    quick = load_config(preset="mock", overrides=("run.cache=false", "engine.joint.optimiser.steps=5"))
    result = reconstruct(world.image, quick, known=KnownSizes(age=tuple(given)))
    person = sorted(result.people, key=lambda one: one.box[0] + one.box[2])[child]
    assert person.age == AgeEstimate(1.0, 4.0, 0.0, pytest.approx(0.04, abs=0.02))
    stature = load_body("embedded").stature(torch.tensor(person.parameters.betas))
    assert float(stature) == pytest.approx(np.exp(load_ages().at_age(4.0)[0]), rel=0.12)
    assert any("is a child of 4 years" in note for note in result.notes)
    result.save(str(tmp_path / "out"), preview=False)
    assert [one.age for one in load_reconstruction(str(tmp_path / "out")).people] == [one.age for one in result.people]


def test_a_photo_of_an_adult_comes_out_as_if_children_were_impossible():
    world = build_world("stand", 0, (160, 120))
    options = ("run.cache=false", "engine.joint.optimiser.steps=5")
    guessed, usual = (
        reconstruct(world.image, load_config(preset="mock", overrides=(*options, *share)))
        for share in (("photo.child_share=0.1",), ())
    )
    person, other = guessed.people[0], usual.people[0]
    assert person.age is not None
    assert person.age.years is None
    assert other.age is None
    assert np.array_equal(person.vertices, other.vertices)
    assert np.array_equal(guessed.scene.points, usual.scene.points, equal_nan=True)
