"""Contact of body parts with the scene: distances, and what the photo and the posture say beside
them.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_core.engine.contact.method import ContactMethod
from physic_core.engine.contact.probability import contact_part_masks, scene_contact
from physic_core.engine.contact.solve import find_contact
from physic_core.engine.ground.touch import LEAST_PROBABILITY
from physic_core.types import ContactPartner
from physic_core.types.skeletons import SIDES

from .adjusted import with_scene, without_joints
from .test_contact_probability import alone, near_of

METHOD = ContactMethod()


@pytest.fixture
def person(body):
    """A person in the rest pose, head up, who stands on a floor."""
    soles = float(body(*body.zero_pose()).vertices[..., 1].min())
    return alone(body, (torch.tensor([0.0, 1.0, 0.0]), -soles))


def touch(state, **changed):
    """Probability of contact with the scene: of the vertices (V,), and of each part; ``changed``
    are other distances.
    """
    near = near_of(state, replace(METHOD, people=False))
    _, vertices, parts = scene_contact(state, replace(near, **changed))
    return vertices[0], {name: float(value) for name, value in parts.items()}


def contact(state):
    return find_contact(state, near_of(state, METHOD), METHOD)


def observed(state, odds):
    """The same state whose feet, hands and seat are observed to touch with these log odds."""
    return replace(state, observed_touch=torch.tensor(odds).expand(1, 5))


def raised(state, height):
    return with_scene(state, floor_offset=state.scene.floor.offset + height)


def test_each_outer_vertex_belongs_to_one_part(body):
    parts = contact_part_masks(body)
    assert {"left_foot", "right_hand", "seat", "back", "torso", "left_lower_arm"} <= set(parts)
    assert torch.equal(torch.stack(list(parts.values())).sum(0), body.outer.long())


def test_parts_touch_less_the_farther_the_scene_is(person):
    near = touch(person)[1]
    far = touch(raised(person, 0.1))[1]
    assert near["left_foot"] > far["left_foot"]
    assert near["seat"] == far["seat"]


def test_a_vertex_touches_at_most_as_its_part_and_more_the_nearer_it_is(person):
    vertices, parts = touch(person)
    foot = contact_part_masks(person.model)["left_foot"]
    height = person.vertices[0, foot, 1] + person.scene.floor.offset
    sole = height < 0.01
    assert vertices[foot].max() <= parts["left_foot"]
    assert vertices[foot][sole].max() > 0.9 * parts["left_foot"]
    instep = (height > 0.04) & (height < 0.06)
    assert vertices[foot][sole].mean() > vertices[foot][instep].mean() + 0.2
    assert vertices[contact_part_masks(person.model)["left_hand"]].max() <= parts["left_hand"]
    assert vertices[~person.model.outer].max() == 0


@pytest.mark.parametrize("part", ["left_foot", "right_hand", "seat"])
def test_parts_that_are_observed_to_touch_do_so_more(person, part):
    more, less = (touch(observed(person, odds))[1] for odds in (2.0, -2.0))
    assert more[part] > less[part]


def test_without_an_observer_feet_are_those_of_an_average_person(person):
    assert touch(observed(person, 0.0))[1] == touch(person)[1]


def test_a_result_has_the_probability_of_each_part_listed_or_not(body, make_stage):
    """A person in the air who sits: the seat, which the picture shows, is hidden, and listed from
    one half on.
    """
    bends = {
        f"{side}_{joint}": (sign * 1.6, 0, 0)
        for side in SIDES
        for joint, sign in (("hip", -1), ("knee", 1))
    }
    stage = make_stage([(bends, (0.0, 0.0, 3.0))])
    over = alone(body, (torch.tensor([0.0, -1.0, 0.0]), 3.0))
    seat = replace(over.joint, vertices=stage.vertices, joints=stage.joints)
    sits = replace(over, joint=seat)
    found = contact(observed(sits, [0.0, 0.0, -4.0, -4.0, 4.0]))
    assert set(found.parts) == set(contact_part_masks(body))
    assert {one.partner for one in found.contacts[0]} == {ContactPartner("hidden", "seat")}
    assert LEAST_PROBABILITY <= float(found.parts["seat"]) < 1
    assert all(float(found.parts[f"{side}_hand"]) < LEAST_PROBABILITY for side in SIDES)


def cut_at_the_knees(given):
    """The same person, of whom a picture shows nothing below the hips but hands."""
    return without_joints(given, "knee", "ankle", "foot")


def test_limbs_that_no_pixel_shows_have_the_base_rate_wherever_they_are(person):
    cut = cut_at_the_knees(person)
    apart = cut_at_the_knees(raised(person, 0.1))
    found = touch(cut)[1]
    seen = touch(person)[1]
    there = touch(apart)[1]
    assert (found["left_foot"], found["seat"]) == (there["left_foot"], there["seat"])
    assert found["left_foot"] == found["right_foot"] != seen["left_foot"]
    assert 0.5 < found["left_foot"] < 0.95
    assert found["seat"] < LEAST_PROBABILITY
    assert found["left_hand"] == seen["left_hand"]
    everywhere = torch.ones(cut.vertices.shape[:2], dtype=torch.bool)
    assert touch(cut, in_mask=everywhere)[1] == seen


def test_unseen_feet_touch_less_the_more_a_hand_does(person):
    cut = cut_at_the_knees(person)
    holds, does_not = (touch(observed(cut, odds))[1] for odds in (4.0, -4.0))
    assert holds["left_hand"] > does_not["left_hand"]
    assert holds["left_foot"] < does_not["left_foot"] - 0.02


def test_contacts_of_limbs_that_no_pixel_shows_are_listed_as_assumed(person):
    measured = contact(person)
    cut = contact(cut_at_the_knees(person))
    assert {one.part for one in measured.contacts[0]} >= {"left_foot", "right_foot"}
    assert not any(one.assumed for one in measured.contacts[0])
    feet = [one for one in cut.contacts[0] if one.part.endswith("foot")]
    assert len(feet) == 2
    assert all(one.assumed for one in feet)
    assert [one.probability for one in feet] == pytest.approx(
        [float(cut.parts["left_foot"][0])] * 2, abs=1e-4
    )
    vertices = cut.probability[0, contact_part_masks(person.model)["left_foot"]]
    assert vertices.max() <= cut.parts["left_foot"][0] + 0.02


def test_unseen_hands_hold_nothing(person):
    gone = without_joints(person, "wrist")
    assert all(float(contact(gone).parts[f"{side}_hand"][0]) < LEAST_PROBABILITY for side in SIDES)
