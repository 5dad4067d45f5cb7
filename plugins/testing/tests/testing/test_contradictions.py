"""The checker of results finds what is planted, and nothing in the results of worlds; those are
checked where all worlds are run, in tests/pipeline/test_sentences.py.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core import Pipeline, load_config
from physic_core.types import (
    BodyContact,
    CheckState,
    ContactPartner,
    SupportState,
    UnposedPerson,
)
from physic_testing.contradictions import contradictions
from physic_testing.worlds import load_world

PALM = BodyContact("left_hand", ContactPartner("self", part="left_hand"), 0.9, 40)
NOBODY = BodyContact("left_hand", ContactPartner("person", person=2, part="back"), 0.9, 40)
MIRROR = BodyContact("head", ContactPartner("person", person=1, part="head"), 0.9, 40)


@pytest.fixture(scope="module")
def hug(few_steps):
    with Pipeline(load_config(preset="mock")) as pipeline:
        return pipeline(load_world("hug", (160, 120)).image)


def first(result, **changes):
    """The result with other fields of the first person."""
    return replace(result, people=(replace(result.people[0], **changes), *result.people[1:]))


def failed(result, *, named):
    """The result with a failed check of the first person, which is among the failed ones or not."""
    checks = tuple(
        replace(check, state=CheckState.FAILED, value=1.0)
        if (check.name, check.person) == ("limb_keypoints", 0)
        else check
        for check in result.checks
    )
    names = ("limb_keypoints",) if named else ()
    return first(replace(result, checks=checks), failed_checks=names, why="No check fails.")


def with_contact(result, contact):
    return first(result, contacts=(*result.people[0].contacts, contact))


def without_floor(result):
    return replace(result, scene=replace(result.scene, floor=None))


def in_the_air(result):
    support = replace(result.people[0].support, state=SupportState.AIRBORNE, contacts=())
    return first(result, support=support)


def box_of(person):
    return UnposedPerson(tuple(map(float, person.box)), 0.6, "no pose fits the box")


PLANTED = {
    "a failed check that is not listed": (
        lambda r: failed(r, named=False),
        "contradict its checks",
    ),
    "a failed check that why does not name": (lambda r: failed(r, named=True), "does not name"),
    "failed checks, and none": (lambda r: failed(r, named=True), "says that none fails"),
    "a floor that is not found": (without_floor, "floor that is not found"),
    "a part that touches itself": (lambda r: with_contact(r, PALM), "with itself"),
    "somebody who is not there": (lambda r: with_contact(r, NOBODY), "not there"),
    "a touch of one side": (lambda r: with_contact(r, MIRROR), "touched back"),
    "a contact twice": (lambda r: with_contact(r, r.people[0].contacts[0]), "contact twice"),
    "people who are not counted": (
        lambda r: replace(r, notes=("scale from 3 people",)),
        "3 people are not there",
    ),
    "others of one person": (
        lambda r: replace(r, people=r.people[:1], warnings=("other people are taller",)),
        "no other people",
    ),
    "a person in the air who stands": (in_the_air, "in the air"),
    "trust over its marks": (lambda r: first(r, trust=0.99, trust_pose=0.1), "more trust"),
    "a body without a pose": (lambda r: replace(r, unposed=(box_of(r.people[0]),)), "has a pose"),
    "the same pixels": (lambda r: first(r, mask=r.people[1].mask), "the same pixels"),
    "a posture of no probability": (
        lambda r: first(r, posture="sit", posture_probability=None),
        "without a probability",
    ),
    "a touch that is not listed": (
        lambda r: first(r, world_contact={"seat": 0.9}),
        "which is not listed",
    ),
    "vertices that touch nothing": (
        lambda r: first(r, contact=np.ones_like(r.people[0].contact)),
        "with nothing",
    ),
}


def test_a_hug_contradicts_nothing(hug):
    assert contradictions(hug) == []


@pytest.mark.parametrize("fault", PLANTED)
def test_what_is_planted_is_found(hug, fault):
    plant, words = PLANTED[fault]
    assert any(words in text for text in contradictions(plant(hug)))
