"""Probability that body parts touch the world, listed or not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core.body import load_body
from physic_core.errors import PhysicError
from physic_core.metrics.world_contact import world_contact, world_parts
from physic_core.types import BodyContact, ContactPartner

PARTNERS = tuple(ContactPartner(kind) for kind in ("floor", "hidden", "self", "person", "object"))


@pytest.fixture(scope="module")
def body():
    return load_body("embedded")


@pytest.fixture
def probability_of(reconstruction, body):
    """Probability of each part where vertices of some parts have a probability, and touch a partner by its index."""

    def measure(contacts=(), **touches: tuple[float, int]) -> dict[str, float]:
        likely = np.zeros(body.num_vertices, np.float16)
        partner = np.full(body.num_vertices, -1, np.int16)
        for name, (probability, index) in touches.items():
            likely[world_parts(body)[name]], partner[world_parts(body)[name]] = probability, index
        person = replace(
            reconstruction.people[0], contact_probability=likely, contact_partner=partner, contacts=tuple(contacts)
        )
        return world_contact(replace(reconstruction, contact_partners=PARTNERS), person, body)

    return measure


def test_parts_lie_where_their_names_say(body):
    parts, rest = world_parts(body), body(*body.zero_pose()).vertices[0].numpy()
    sides = [f"{side}_{name}" for side in ("left", "right") for name in ("foot", "hand", "forearm", "knee")]
    assert set(parts) == {*sides, "seat", "back"}
    for name, rows in parts.items():
        assert 0.08 < np.ptp(rest[rows], axis=0).max() < 0.7, name
        if name.startswith("left"):
            assert rest[rows, 0].mean() > 0
    assert rest[parts["left_knee"], 2].mean() > rest[parts["seat"], 2].mean()


def test_a_part_has_the_mean_probability_of_its_surest_vertices(probability_of):
    found = probability_of(left_foot=(0.75, 0), right_foot=(0.25, -1), back=(0.5, 1))
    for name, value in (("left_foot", 0.75), ("right_foot", 0.25), ("back", 0.5)):
        assert found[name] == pytest.approx(value)
    assert found["left_hand"] < 0.01


@pytest.mark.parametrize("partner", [2, 3, 4])
def test_own_body_people_and_objects_are_not_the_world(probability_of, partner):
    assert probability_of(left_hand=(1.0, partner))["left_hand"] < 0.01
    assert probability_of(left_hand=(1.0, 0))["left_hand"] > 0.9


def test_a_listed_part_has_at_least_its_listed_probability(probability_of):
    listed = [
        BodyContact("left_hand", PARTNERS[1], 0.8, 5),
        BodyContact("left_hand", PARTNERS[0], 0.6, 5),
        BodyContact("right_hand", PARTNERS[2], 0.9, 5),
        BodyContact("left_lower_arm", PARTNERS[0], 0.7, 5),
    ]
    found = probability_of(listed)
    assert (found["left_hand"], found["left_forearm"]) == (0.8, 0.7)
    assert found["right_hand"] < 0.01


def test_a_result_without_probabilities_has_none_of_parts(reconstruction, body):
    with pytest.raises(PhysicError, match="no probabilities of contact"):
        world_contact(reconstruction, replace(reconstruction.people[0], contact_probability=None), body)
