"""Contact of body parts with the scene: distances, and what the photo and the posture say beside them."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.contact.method import ContactMethod
from physic_core.engine.contact.parts import LEAST_PROBABILITY, scene_parts_of_body, weigh_parts
from physic_core.engine.contact.probability import mean_of_surest
from physic_core.engine.contact.solve import solve_contact
from physic_core.types import ContactPartner
from physic_core.types.skeletons import SIDES

from .test_contact_probability import alone


@pytest.fixture
def person(body):
    """A person in the rest pose, head up, far from everything."""
    return alone(body, plane=(torch.tensor([0.0, 1.0, 0.0]), 3.0))


def likely(person, value: float) -> torch.Tensor:
    return torch.full(person.vertices.shape[:2], value)


def test_each_outer_vertex_belongs_to_one_part(body):
    parts = scene_parts_of_body(body)
    assert {"left_foot", "right_hand", "seat", "back", "torso", "left_lower_arm"} <= set(parts)
    assert torch.equal(torch.stack(list(parts.values())).sum(0), body.outer.long())


def test_the_vertices_of_a_part_get_its_probability_and_keep_their_order(person):
    before = likely(person, 0.01) + 0.5 * torch.rand(person.vertices.shape[:2], generator=torch.manual_seed(0))
    after, parts = weigh_parts(person, before)
    for name, chosen in scene_parts_of_body(person.model).items():
        assert mean_of_surest(after[0, chosen]) == pytest.approx(float(parts[name]), abs=0.05)
        assert torch.equal(after[0, chosen].argsort(), before[0, chosen].argsort())


def test_a_foot_touches_as_the_picture_says(person):
    seen = replace(person, foot_touch=torch.tensor([[0.2, 0.95]]))
    _, parts = weigh_parts(seen, likely(seen, 0.5))
    assert float(parts["left_foot"]) < float(parts["right_foot"])


def test_feet_that_do_not_stand_on_the_floor_touch_less(person):
    found = [weigh_parts(replace(person, standing=torch.tensor([z])), likely(person, 0.7))[1] for z in (0.0, -4.0)]
    for foot in ("left_foot", "right_foot"):
        assert float(found[1][foot]) < float(found[0][foot])
    above = weigh_parts(replace(person, standing=torch.tensor([2.0])), likely(person, 0.7))[1]
    assert float(above["left_foot"]) == float(found[0]["left_foot"])


def test_unknown_evidence_is_none(person):
    unknown = replace(person, standing=torch.tensor([torch.nan]))
    for name, probability in weigh_parts(unknown, likely(person, 0.4))[1].items():
        assert float(probability) == float(weigh_parts(person, likely(person, 0.4))[1][name])


def test_level_thighs_make_a_seat_likely_even_where_the_depth_has_lost_it(person):
    joints = person.joints.clone()
    for side in ("left", "right"):
        hip, knee = JOINT_INDEX[f"{side}_hip"], JOINT_INDEX[f"{side}_knee"]
        joints[:, knee] = joints[:, hip] + torch.tensor([0.0, 0.0, 0.4])
    sits = replace(person, joints=joints)
    upright, seated = (float(weigh_parts(who, likely(who, 0.01))[1]["seat"]) for who in (person, sits))
    assert upright < 0.15
    assert seated > 0.4
    assert seated == float(weigh_parts(sits, likely(sits, 0.3))[1]["seat"])
    assert float(weigh_parts(sits, likely(sits, 0.9))[1]["seat"]) > seated


def test_a_result_has_the_probability_of_each_part_listed_or_not(body, make_stage):
    """A person in the air who sits: the seat is hidden, and a part with one half or more is listed."""
    bends = {f"{side}_{joint}": (sign * 1.45, 0, 0) for side in SIDES for joint, sign in (("hip", -1), ("knee", 1))}
    stage = make_stage([(bends, (0.0, 0.0, 3.0))])
    sits = replace(
        alone(body, plane=(torch.tensor([0.0, -1.0, 0.0]), 3.0)),
        vertices=stage.vertices,
        joints=stage.joints,
        rotations=stage.problem.rotations0,
    )
    found = solve_contact(sits, ContactMethod())
    assert set(found.parts) == set(scene_parts_of_body(body))
    assert {one.partner for one in found.contacts[0]} == {ContactPartner("hidden", "seat")}
    assert LEAST_PROBABILITY <= float(found.parts["seat"]) < 1
    assert all(float(found.parts[f"{side}_hand"]) < LEAST_PROBABILITY for side in SIDES)
