"""Contact of body parts with the scene: distances, and what the photo and the posture say beside
them.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_core.engine.contact.method import ContactStageMethod
from physic_core.engine.contact.probability import contact_part_masks, mean_of_largest
from physic_core.engine.contact.solve import find_contact
from physic_core.types import ContactPartner
from physic_core.types.observations import LEAST_PROBABILITY
from physic_core.types.skeletons import SIDES

from .adjusted import with_result, with_scene, without_joints
from .test_contact_probability import alone, near_of
from .touching import LIMBS, with_touch

METHOD = ContactStageMethod()


@pytest.fixture
def person(body):
    """A person in the rest pose, head up, who stands on a floor."""
    soles = float(body(*body.zero_pose()).vertices[..., 1].min())
    return alone(body, (torch.tensor([0.0, 1.0, 0.0]), -soles))


def touch(state):
    """Probability of contact with the scene: of the vertices (V,), and of each part."""
    method = replace(METHOD, people=False)
    found = method.find_touch(state, near_of(state, method))
    return found.probability[0], {
        name: float(value) for name, value in found.part_probability.items()
    }


def contact(state):
    return find_contact(state, near_of(state, METHOD), METHOD)


def limbs_on_world(state, probability):
    return with_touch(state, **dict.fromkeys(LIMBS, ("world", probability)))


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
    assert near["left_lower_leg"] >= far["left_lower_leg"]
    assert near["seat"] == far["seat"]


def test_four_vertices_out_of_place_bring_no_part_near(person):
    up = raised(person, 0.1)
    foot = contact_part_masks(person.model)["left_foot"].nonzero()[:4, 0]
    vertices = up.vertices.clone()
    vertices[0, foot, 1] = -up.scene.floor.offset
    off = replace(up, joint=replace(up.joint, vertices=vertices))
    assert touch(off)[1]["left_foot"] == pytest.approx(touch(up)[1]["left_foot"], abs=0.01)


def test_the_surest_vertices_have_the_probability_of_their_part(person):
    vertices, parts = touch(person)
    for name, chosen in contact_part_masks(person.model).items():
        assert mean_of_largest(vertices[chosen]) == pytest.approx(parts[name], rel=1e-4)
    foot = contact_part_masks(person.model)["left_foot"]
    height = person.vertices[0, foot, 1] + person.scene.floor.offset
    instep = (height > 0.04) & (height < 0.06)
    assert vertices[foot][height < 0.01].mean() > vertices[foot][instep].mean() + 0.2
    assert vertices[~person.model.outer].max() == 0


@pytest.mark.parametrize("part", ["left_foot", "right_hand", "seat"])
def test_parts_that_are_observed_to_touch_do_so_more(person, part):
    more, less = (touch(limbs_on_world(person, p))[1] for p in (0.9, 0.1))
    assert more[part] > less[part]


def test_without_an_observer_feet_are_those_of_an_average_person(person):
    assert touch(with_touch(person))[1] == touch(person)[1]


def test_a_hand_that_holds_an_object_touches_it_and_nothing_of_the_world(person):
    found = contact(with_touch(person, left_hand=("object", 0.9)))
    [held] = [one for one in found.contacts[0] if one.partner.kind == "object"]
    assert held.part == "left_hand"
    assert held.probability > 0.8
    assert found.part_probability["left_hand"] < 0.2
    assert not any(one.partner.kind == "object" for one in found.supports[0].contacts)


@pytest.mark.parametrize(
    ("height", "on_floor", "partner", "off_m"),
    [
        (0.0, None, ContactPartner("floor", "floor"), None),
        (0.12, None, ContactPartner("hidden"), 0.12),
        (0.5, None, ContactPartner("hidden"), 0.15),
        (0.12, 0.98, ContactPartner("floor", "floor"), 0.12),
        (0.0, 0.02, ContactPartner("scene"), None),
    ],
)
def test_feet_that_surely_touch_are_where_they_are_seen_or_on_what_is_near(
    person, height, on_floor, partner, off_m
):
    floor = None if on_floor is None else torch.full((1, 2), on_floor)
    said = replace(limbs_on_world(raised(person, height), 0.99), observed_floor=floor)
    found = contact(said).contacts[0]
    feet = [one for one in found if one.part.endswith("_foot")]
    assert [one.partner for one in feet] == [partner] * 2
    assert [one.distance_m for one in feet] == [off_m and pytest.approx(off_m, abs=0.01)] * 2
    assert all(one.probability > 0.8 for one in feet)


def test_parts_of_which_nobody_speaks_touch_only_what_is_near(person):
    """The back of a person who lies on the floor, not on the seat, and a hand's breadth over it."""
    axes = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    vertices = person.vertices @ axes.T
    back = contact_part_masks(person.model)["back"]
    moved = replace(person.joint, vertices=vertices, joints=person.joints @ axes.T)
    lies = with_touch(replace(person, joint=moved), seat=("world", 0.02))
    lowest = float(vertices[0, back, 1].max())
    on, over = (with_scene(lies, floor_offset=lowest + gap - 0.02) for gap in (0.0, 0.12))
    assert touch(over)[1]["back"] < LEAST_PROBABILITY
    assert "back" not in {one.part for one in contact(over).contacts[0]}
    on_seat = touch(with_touch(on, seat=("world", 0.98)))[1]
    assert on_seat["head"] == on_seat["back"] == on_seat["seat"] > LEAST_PROBABILITY
    assert touch(on)[1]["head"] < on_seat["head"]
    carried = contact(with_touch(over, seat=("world", 0.98))).contacts[0]
    assert {"head", "back", "seat"} <= {one.part for one in carried}


@pytest.mark.parametrize("part", ["back", "seat"])
def test_a_part_without_skin_that_faces_down_does_not_touch_what_it_is_far_from(person, part):
    """The back of a person who lies face down, and on the back, or sits, by the observer."""
    axes = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    vertices = person.vertices @ axes.T
    moved = replace(person.joint, vertices=vertices, joints=person.joints @ axes.T)
    lies = with_touch(replace(person, joint=moved), **{part: ("world", 0.9)})
    found = contact(with_scene(lies, floor_offset=-float(vertices[0, :, 1].min())))
    assert float(found.part_probability[part]) < LEAST_PROBABILITY
    assert part not in {one.part for one in found.contacts[0]}


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
    sits = with_result(over, stage)
    found = contact(
        with_touch(
            sits,
            left_hand=("world", 0.02),
            right_hand=("world", 0.02),
            seat=("world", 0.98),
        )
    )
    assert set(found.part_probability) == set(contact_part_masks(body))
    assert {one.partner for one in found.contacts[0]} == {ContactPartner("hidden", "seat")}
    assert LEAST_PROBABILITY <= float(found.part_probability["seat"]) < 1
    assert all(float(found.part_probability[f"{side}_hand"]) < LEAST_PROBABILITY for side in SIDES)


def cut_at_the_knees(given):
    """The same person, of whom a picture shows nothing below the hips but hands."""
    return without_joints(given, "knee", "ankle", "foot")


def test_contacts_of_limbs_that_no_pixel_shows_are_listed_as_assumed(person):
    measured = contact(person)
    cut = contact(cut_at_the_knees(person))
    assert {one.part for one in measured.contacts[0]} >= {"left_foot", "right_foot"}
    assert not any(one.assumed for one in measured.contacts[0])
    feet = [one for one in cut.contacts[0] if one.part.endswith("foot")]
    assert len(feet) == 2
    assert all(one.assumed for one in feet)
    assert [one.probability for one in feet] == pytest.approx(
        [float(cut.part_probability["left_foot"][0])] * 2, abs=1e-4
    )
    vertices = cut.probability[0, contact_part_masks(person.model)["left_foot"]]
    assert vertices.max() <= cut.part_probability["left_foot"][0] + 0.02


def test_unseen_hands_hold_nothing(person):
    gone = without_joints(person, "wrist")
    assert all(
        float(contact(gone).part_probability[f"{side}_hand"][0]) < LEAST_PROBABILITY
        for side in SIDES
    )
