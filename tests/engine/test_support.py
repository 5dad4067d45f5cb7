"""What carries a person: balance over contacts, hands that hold, and hidden supports."""

from __future__ import annotations

import math
from functools import cache

import pytest
import torch

from physic_core.engine.contact.support import (
    PersonContact,
    find_support,
)
from physic_core.geometry.mesh import vertex_normals

SITS = {
    "left_hip": (-1.45, 0, 0),
    "right_hip": (-1.45, 0, 0),
    "left_knee": (1.45, 0, 0),
    "right_knee": (1.45, 0, 0),
}
SQUATS = {
    "left_hip": (-2.0, 0, 0),
    "right_hip": (-2.0, 0, 0),
    "left_knee": (2.2, 0, 0),
    "right_knee": (2.2, 0, 0),
    "spine1": (0.5, 0, 0),
}
HANGS = {"left_shoulder": (0, 0, 1.4), "right_shoulder": (0, 0, -1.4)}
UP = torch.tensor([0.0, -1.0, 0.0])


@pytest.fixture(scope="module")
def support(make_stage):
    """Return a function that gives the support of a person of some bends: ``touching`` are sets of
    vertices in contact, ``chosen`` selects more of them by the normals, and ``unseen`` are sets
    that the photo does not show.
    """

    @cache
    def posed(bends):
        stage = make_stage([(dict(bends), (0.0, 0.0, 3.0))])
        model = stage.state.model
        return model, stage.vertices[0], vertex_normals(stage.vertices, model.faces)[0]

    def find(
        bends,
        touching=(),
        chosen=None,
        *,
        up=UP,
        assume=True,
        unseen=(),
        feet=True,
        grips=False,
        sits=False,
        lies=False,
        height=0.0,
    ):
        model, vertices, normals = posed(tuple(bends.items()))
        contact = model.contact_set_mask(*touching)
        if chosen is not None:
            contact |= chosen(model, normals)
        person = PersonContact(
            vertices,
            normals,
            contact,
            ~model.contact_set_mask(*unseen),
            feet=torch.tensor([feet] * 2),
            sits=sits,
            lies=lies,
            grips=torch.tensor([grips] * 2),
            height=torch.full((model.num_vertices,), height),
        )
        return model, person, find_support(model, person, up, assume=assume)

    return find


SOLES = ("left_sole", "right_sole")
HANDS = ("left_hand", "right_hand")
SEAT = ("gluteus", "thighs")
ROLLED = {"left_ankle": (0, 0, -0.4)}
AIR = {"feet": False}
CASES = {
    "stands": ({}, SOLES, {}, "balanced", ()),
    "squats": (SQUATS, SOLES, {}, "balanced", ()),
    "heels up by the error of a pose": ({}, SOLES, {"height": 0.08}, "balanced", ()),
    "heels up": ({}, SOLES, {"height": 0.12}, "unsteady", ()),
    "one foot": ({}, ("left_sole",), {}, "balanced", ()),
    "one rolled foot": (ROLLED, ("left_sole",), {}, "unsteady", ()),
    "a rolled foot and the other": (ROLLED, SOLES, {}, "balanced", ()),
    "a rolled foot and a hand": (ROLLED, ("left_sole", "left_hand"), {}, "balanced", ()),
    "unseen feet touch": ({}, SOLES, {"unseen": SOLES}, "assumed", ()),
    "unseen hands": ({}, SOLES, {"unseen": HANDS}, "balanced", ()),
    "one unseen foot": ({}, SOLES, {"unseen": ("left_sole",)}, "balanced", ()),
    "unseen feet touch nothing": ({}, (), {"unseen": SOLES}, "assumed", SOLES),
    "unseen feet, no guess": ({}, (), {"unseen": SOLES, "assume": False}, "unbalanced", ()),
    "seen feet touch nothing": ({}, (), {"grips": True}, "unbalanced", ()),
    "seen feet, a hand touches": ({}, ("left_hand",), {"grips": True}, "unbalanced", ()),
    "sits on nothing": (SITS, (), {"sits": True}, "assumed", SEAT),
    "sits on nothing, soles down": (SITS, SOLES, {"sits": True}, "assumed", SEAT),
    "sits, no guess": (SITS, SOLES, {"assume": False}, "unbalanced", ()),
    "sits on a seat": (SITS, SEAT, {"sits": True}, "balanced", ()),
    "sits over its feet": (SQUATS, SOLES, {"sits": True}, "assumed", SEAT),
    "squats on nothing": (SQUATS, (), {"sits": True}, "assumed", SEAT),
    "squats on unseen feet": (SQUATS, SOLES, {"sits": True, "unseen": SOLES}, "assumed", SEAT),
    "sits, feet in the air": (SITS, (), {"sits": True} | AIR, "assumed", SEAT),
    "one unseen foot, seated": (
        SITS,
        (),
        {"sits": True, "unseen": ("left_sole",)} | AIR,
        "assumed",
        SEAT,
    ),
    "jumps": (HANGS, (), AIR, "airborne", ()),
    "holds something": (HANGS, (), {"grips": True} | AIR, "assumed", HANDS),
    "hands up, seen feet": (HANGS, (), {"grips": True}, "unbalanced", ()),
    "one hand up, seen feet": (HANGS, ("left_hand",), {"grips": True}, "unbalanced", ()),
    "hangs": (HANGS, HANDS, {"assume": False}, "hanging", ()),
    "hangs by unseen hands": (HANGS, HANDS, {"unseen": HANDS}, "assumed", ()),
    "hands below": (HANGS, HANDS, {"assume": False, "up": -UP}, "balanced", ()),
}


@pytest.mark.parametrize("name", CASES)
def test_state_and_hidden_support_of(support, name):
    bends, touching, known, state, hidden = CASES[name]
    model, _, found = support(bends, touching, **known)
    assert found.state == state
    assert found.hidden.any() == bool(hidden)
    assert not (found.hidden & ~model.contact_set_mask(*hidden)).any()
    if state in ("balanced", "unsteady"):
        assert found.outside_m < 0.12
    assert math.isinf(found.outside_m) == (not touching and not hidden)


@pytest.mark.parametrize("touching", [(), SOLES])
def test_a_hidden_seat_is_level(support, touching):
    _, person, found = support(SITS, touching, sits=True)
    assert torch.equal(found.seat, found.hidden)
    heights = person.vertices[found.hidden] @ UP
    assert float(heights.max() - heights.min()) < 0.1


def test_what_carries_a_person_who_lies_is_under_seat_and_back_and_no_seat(support):
    model, _, found = support({}, sits=True, lies=True, up=torch.tensor([0.0, 0.0, -1.0]))
    assert found.state == "assumed"
    assert not found.seat.any()
    assert all((found.hidden & model.contact_set_mask(part)).any() for part in ("back", "gluteus"))


def test_a_hidden_handhold_is_in_the_whole_hand_and_a_seat_in_contact_is_a_seat(support):
    model, _, found = support(HANGS, feet=False, grips=True)
    assert found.hidden[model.contact_sets["left_hand"]].all()
    assert support(SITS, SEAT, sits=True)[2].seat.any()


def few(mask, count):
    return mask & (mask.cumsum(0) <= count)


def test_a_few_vertices_or_the_sides_of_thighs_are_no_seat(support):
    def chosen(model, normals):
        under = model.contact_set_mask(*SEAT)
        return few(under & (normals @ UP < -0.5), 5) | (under & (normals @ UP > -0.1))

    _, person, found = support(SITS, SOLES, chosen, sits=True)
    assert (found.hidden & found.seat & ~person.contact).any()
