"""What carries a person: balance over contacts, hands that hold, and hidden supports."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from physic_core.engine.contact.support import (
    PersonContact,
    distance_to_hull,
    find_support,
    support_record,
)
from physic_core.geometry.mesh import vertex_normals
from physic_core.types import BodyContact, ContactPartner, Support, SupportState

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
def posed(make_stage):
    """Return a function that gives model and posed person of some bends."""

    def pose(bends):
        stage = make_stage([(bends, (0.0, 0.0, 3.0))])
        model = stage.state.model
        normals = vertex_normals(stage.vertices, model.faces)[0]
        return model, SimpleNamespace(vertices=stage.vertices[0], normals=normals)

    return pose


def members(model, *names):
    chosen = torch.zeros(model.num_vertices, dtype=torch.bool)
    for name in names:
        chosen[model.contact_sets[name]] = True
    return chosen


def evidence(model, *touching, feet=True, holds=False, unseen=(), sits=False, height=0.0):
    """Contact of sets of vertices at a height over the ground, whether feet and hands probably
    touch, and sets that the photo does not show.
    """
    return SimpleNamespace(
        contact=members(model, *touching),
        seen=~members(model, *unseen),
        feet=torch.tensor([feet, feet]),
        sits=sits,
        holds=torch.tensor([holds, holds]),
        height=torch.full((model.num_vertices,), height),
    )


def support_of(model, body, evidence, up, *, assume):
    person = PersonContact(**vars(body), **vars(evidence))
    return find_support(model, person, up, assume=assume)


def within(model, chosen, *names):
    return not bool((chosen & ~members(model, *names)).any())


@pytest.mark.parametrize("bends", [{}, SQUATS])
def test_feet_balance_people_who_stand_or_squat(posed, bends):
    model, body = posed(bends)
    found = support_of(model, body, evidence(model, "left_sole", "right_sole"), UP, assume=True)
    assert found.state == SupportState.BALANCED
    assert found.outside_m < 0.12
    assert not found.hidden.any()


@pytest.mark.parametrize(
    ("height", "roll", "touching", "state"),
    [
        (0.08, 0.0, ("left_sole", "right_sole"), "balanced"),  # the error of a pose
        (0.12, 0.0, ("left_sole", "right_sole"), "unsteady"),
        (0.0, 0.0, ("left_sole",), "balanced"),
        (0.0, -0.4, ("left_sole",), "unsteady"),
        (0.0, -0.4, ("left_sole", "right_sole"), "balanced"),
        (0.0, -0.4, ("left_sole", "left_hand"), "balanced"),
    ],
)
def test_feet_alone_balance_a_person_only_on_heels_with_enough_ground(
    posed, height, roll, touching, state
):
    model, body = posed({"left_ankle": (0, 0, roll)})
    found = support_of(model, body, evidence(model, *touching, height=height), UP, assume=True)
    assert found.state == state
    assert found.outside_m < 0.12


@pytest.mark.parametrize(
    ("unseen", "state"),
    [
        (("left_sole", "right_sole"), "assumed"),
        (("left_hand", "right_hand"), "balanced"),
        (("left_sole",), "balanced"),  # the other sole is near enough below the centre of mass
    ],
)
def test_support_that_needs_feet_without_a_visible_pixel_is_assumed(posed, unseen, state):
    model, body = posed({})
    found = support_of(
        model, body, evidence(model, "left_sole", "right_sole", unseen=unseen), UP, assume=True
    )
    assert found.state == state
    assert not found.hidden.any()
    assert found.contact[model.contact_sets["left_sole"]].any()


def test_hands_without_a_visible_pixel_hang_by_assumption(posed):
    model, body = posed(HANGS)
    hands = ("left_hand", "right_hand")
    assert (
        support_of(model, body, evidence(model, *hands, unseen=hands), UP, assume=True).state
        == "assumed"
    )


@pytest.mark.parametrize("touching", [(), ("left_sole", "right_sole")])
def test_a_hidden_seat_carries_a_person_who_sits_on_nothing_visible(posed, touching):
    model, body = posed(SITS)
    found = support_of(model, body, evidence(model, *touching, sits=True), UP, assume=True)
    assert found.state == SupportState.ASSUMED
    assert found.hidden.any()
    assert torch.equal(found.seat, found.hidden)
    assert within(model, found.hidden, "gluteus", "thighs")
    heights = body.vertices[found.hidden] @ UP
    assert float(heights.max() - heights.min()) < 0.1
    assert (
        support_of(model, body, evidence(model, *touching), UP, assume=False).state
        == SupportState.UNBALANCED
    )


def test_no_seat_is_assumed_for_a_squatter_whom_seen_feet_balance(posed):
    model, body = posed(SQUATS)
    soles = evidence(model, "left_sole", "right_sole", sits=True)
    found = support_of(model, body, soles, UP, assume=True)
    assert found.state == SupportState.BALANCED
    assert not found.hidden.any()
    assert support_of(model, body, evidence(model, sits=True), UP, assume=True).hidden.any()
    soles.seen = ~members(model, "left_sole", "right_sole")
    assert support_of(model, body, soles, UP, assume=True).hidden.any()


@pytest.mark.parametrize(("unseen", "state"), [((), "airborne"), (("left_sole",), "assumed")])
def test_no_seat_is_assumed_for_a_jumper_whose_feet_are_both_seen(posed, unseen, state):
    model, body = posed(SITS)
    jumps = evidence(model, feet=False, sits=True, unseen=unseen)
    assert support_of(model, body, jumps, UP, assume=True).state == state


def test_a_seat_in_contact_needs_no_hidden_one(posed):
    model, body = posed(SITS)
    found = support_of(
        model, body, evidence(model, "gluteus", "thighs", sits=True), UP, assume=True
    )
    assert found.state == SupportState.BALANCED
    assert found.seat.any()
    assert not found.hidden.any()


def test_a_few_vertices_or_the_sides_of_thighs_are_no_seat(posed):
    model, body = posed(SITS)
    sits = evidence(model, "left_sole", "right_sole", sits=True)
    under = members(model, "gluteus", "thighs")
    sits.contact[(under & (body.normals @ UP < -0.5)).nonzero()[:5, 0]] = True
    sits.contact[under & (body.normals @ UP > -0.1)] = True
    found = support_of(model, body, sits, UP, assume=True)
    assert (found.hidden & found.seat & ~sits.contact).any()


def test_a_person_in_the_air_holds_something_or_jumps_by_the_touch_of_the_hands(posed):
    model, body = posed(HANGS)
    holds = support_of(model, body, evidence(model, feet=False, holds=True), UP, assume=True)
    assert holds.state == SupportState.ASSUMED
    assert within(model, holds.hidden, "left_hand", "right_hand")
    assert holds.hidden[model.contact_sets["left_hand"]].all()
    jumps = support_of(model, body, evidence(model, feet=False), UP, assume=True)
    assert jumps.state == SupportState.AIRBORNE
    assert math.isinf(jumps.outside_m)


def test_feet_that_the_photo_does_not_show_stand_on_something_hidden(posed):
    model, body = posed({})
    unseen = evidence(model, unseen=("left_sole", "right_sole"))
    found = support_of(model, body, unseen, UP, assume=True)
    assert found.state == SupportState.ASSUMED
    assert within(model, found.hidden, "left_sole", "right_sole")
    assert support_of(model, body, unseen, UP, assume=False).state == SupportState.UNBALANCED


@pytest.mark.parametrize("bends", [{}, HANGS])
@pytest.mark.parametrize("touching", [(), ("left_hand",)])
def test_people_with_visible_feet_get_no_hidden_support(posed, bends, touching):
    model, body = posed(bends)
    found = support_of(model, body, evidence(model, *touching, holds=True), UP, assume=True)
    assert not found.hidden.any()


def test_hands_above_the_centre_of_mass_carry_alone(posed):
    model, body = posed(HANGS)
    high = support_of(model, body, evidence(model, "left_hand", "right_hand"), UP, assume=False)
    assert high.state == SupportState.HANGING
    low = support_of(model, body, evidence(model, "left_hand", "right_hand"), -UP, assume=False)
    assert low.state != SupportState.HANGING


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(3, 30))
def test_the_distance_to_the_hull_is_that_of_its_edges(seed, count):
    draw = np.random.default_rng(seed)
    points = draw.normal(size=(count, 3))
    centre = draw.normal(size=3)
    hull = ConvexHull(points[:, [0, 2]])
    inside = float((hull.equations @ np.append(centre[[0, 2]], 1.0)).max())
    found = distance_to_hull(*(torch.tensor(x) for x in (centre, points)), UP.double())
    # The supporting lines of 360 directions miss 1 % of the hull's size.
    slack = 0.01 * float(np.ptp(points, axis=0).max())
    if inside <= 0:
        assert inside - slack <= found <= inside + slack
    else:
        corners = points[hull.vertices][:, [0, 2]]
        ends = np.roll(corners, -1, axis=0)
        share = ((centre[[0, 2]] - corners) * (ends - corners)).sum(1) / (
            (ends - corners) ** 2
        ).sum(1)
        nearest = corners + np.clip(share, 0, 1)[:, None] * (ends - corners)
        distance = float(np.linalg.norm(centre[[0, 2]] - nearest, axis=1).min())
        assert distance - slack <= found <= distance + 1e-9


def test_a_support_lists_its_large_likely_contacts_with_their_probability(posed):
    model, body = posed(SITS)
    found = support_of(
        model, body, evidence(model, "left_sole", "right_sole", sits=True), UP, assume=True
    )
    floor = ContactPartner("floor", "floor")
    seat = ContactPartner("hidden", "seat")
    carrying = (
        BodyContact("left_foot", floor, None, 90),
        BodyContact("right_hand", floor, None, 9),
        BodyContact("seat", seat, None, 5),
        BodyContact("left_hand", floor, None, 40),
    )
    listed = (BodyContact("left_foot", floor, 0.7, 120), BodyContact("left_hand", floor, 0.4, 40))
    support = support_record(found, carrying, listed)
    assert support.contacts == (replace(carrying[0], probability=0.7), carrying[2])
    assert support.hidden == ("hidden seat",)
    assert str(support) == "assumed: left foot on floor, a seat that the scene does not show"
    assert support.outside_m == pytest.approx(found.outside_m, abs=1e-4)


@pytest.mark.parametrize(
    ("part", "name"),
    [
        ("left_upper_leg", "hidden support under the thighs"),
        ("right_hand", "hidden handhold"),
        ("back", "hidden support behind the back"),
        ("left_foot", "hidden support under the feet"),
    ],
)
def test_names_of_hidden_supports(part, name):
    support = Support(
        "assumed", (BodyContact(part, ContactPartner("hidden"), 0.5, 9),), None, (0.0, 0.0, 1.0)
    )
    assert support.hidden == (name,)
    assert str(support) == f"assumed: a {name.removeprefix('hidden ')} that the scene does not show"


def test_an_upright_surface_and_few_vertices_that_face_down_carry_no_person(posed):
    model, body = posed(HANGS)
    seen = evidence(model, feet=False, holds=True)
    facing_down = (body.normals @ UP < -0.5) & (
        model.part_of_vertex == model.part_names.index("left_upper_leg")
    )
    seen.contact[facing_down.nonzero()[:9, 0]] = True
    seen.contact[
        (body.normals[:, 2] < -0.9) & (model.part_of_vertex == model.part_names.index("torso"))
    ] = True
    found = support_of(model, body, seen, UP, assume=True)
    assert found.state == SupportState.ASSUMED
    assert within(model, found.hidden, "left_hand", "right_hand")
