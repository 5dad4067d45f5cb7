"""The probability of contact with scene and skin, and the gap that vertices of a part share."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from physic_core import engine_preset
from physic_core.engine.contact.distances import KINDS, ContactSurfaces
from physic_core.engine.contact.probability import part_gaps
from physic_core.engine.contact.solve import find_contact, measure_distances
from physic_core.engine.ground.touch import (
    HAND,
    INSIDE,
    OUTSIDE,
    OWN_BODY,
    SKIN,
    touch_log_odds,
    touch_model,
)
from physic_core.geometry.neighbors import NearestPointSearch
from physic_core.types import SKELETONS, Intrinsics

from .adjusted import with_result
from .conftest import state_of

OWN_BODY_KIND = KINDS.index("own body")


def odds(outside=0.0, inside=0.0, hand=1.0, own=1.0):
    return touch_log_odds(SKIN, {OUTSIDE: outside, INSIDE: inside, HAND: hand, OWN_BODY: own})


@given(st.floats(0, 2.5), st.floats(0.05, 0.5), st.sampled_from([0.0, 1.0]))
def test_farther_skin_is_touched_less_probably(outside, farther, hand):
    assert odds(outside + farther, hand=hand) < odds(outside, hand=hand)


def test_hands_touch_the_own_body_more_often_than_other_limbs_do():
    assert odds() > odds(hand=0.0)


def test_the_gap_of_a_part_is_its_fifth_smallest_distance():
    distance = torch.tensor([[0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.5, 0.4, math.inf]])
    group = torch.tensor([[0, 0, 0, 0, 0, 0, 1, 1, 1]])
    gaps = part_gaps(distance, group)[0]
    assert gaps[:6].tolist() == pytest.approx([0.05] * 6)
    assert gaps[6:].tolist() == [0.5, 0.5, math.inf]


def alone(body, plane=None, **known):
    """A person in the rest pose who is near no point of a scene."""
    posed = body(*body.zero_pose())
    state = state_of(
        body,
        *body.zero_pose(),
        depth=np.full((2, 2), np.nan),
        floor=plane,
        camera=Intrinsics.from_focal(1.0, 2, 2),
        skeleton=SKELETONS["coco17"],
        keypoints=torch.zeros(1, 17, 2),
        keypoint_confidence=torch.zeros(1, 17),
        masks=torch.zeros(1, 2, 2, dtype=torch.bool),
        contact_prior=torch.full(posed.vertices.shape[:2], 0.5),
        **known,
    )
    return with_result(state, posed)


def near_of(state, method):
    """Distances of people who are near no point of a scene."""
    empty = NearestPointSearch(torch.zeros(0, 3), torch.zeros(0, 3))
    none = torch.zeros(0, dtype=torch.int64)
    surfaces = ContactSurfaces(empty, none, state.scene.floor)
    return measure_distances(state, surfaces, (("unknown",), none), method)


def test_up_is_that_of_an_upright_camera_without_a_floor(body):
    assert alone(body).up.tolist() == [0.0, -1.0, 0.0]


def always_touched(monkeypatch, probability):
    """Let skin touch what is near it with a probability."""
    constant = math.log(probability / (1 - probability))
    nothing = dict.fromkeys((OUTSIDE, INSIDE, HAND, OWN_BODY), 0.0)
    monkeypatch.setitem(touch_model(), SKIN, {"constant": constant, **nothing})


@pytest.mark.parametrize(("skin", "kinds"), [(0.9, {OWN_BODY_KIND}), (0.6, {-1}), (0.4, {-1})])
def test_a_vertex_touches_skin_if_its_part_probably_does(body, monkeypatch, skin, kinds):
    given = alone(body)
    method = replace(engine_preset("default").contact, threshold=0.7)
    near = near_of(given, method)
    at = near.own.vertex.clone()
    hand, thigh = (body.contact_sets[name] for name in ("left_hand", "thighs"))
    at[0, hand] = thigh[0]
    distance = torch.full_like(near.own.distance, torch.inf)
    distance[0, hand] = 0.0
    normals = near.normals.clone()
    normals[0, hand] = -normals[0, thigh[0]]
    near = replace(near, normals=normals, own=replace(near.own, distance=distance, vertex=at))
    always_touched(monkeypatch, skin)
    assert set(method.find_touch(given, near).kind[0, hand].unique().tolist()) == kinds


def test_parts_that_meet_at_a_joint_do_not_touch(body, monkeypatch):
    given = alone(body)
    method = engine_preset("default").contact
    near = near_of(given, method)
    near = replace(near, own=replace(near.own, distance=torch.zeros_like(near.own.distance)))
    always_touched(monkeypatch, 0.99)
    arm = body.part_of_vertex == body.part_names.index("left_lower_arm")
    at = near.own.vertex.clone()
    at[:] = int(torch.nonzero(body.part_of_vertex == body.part_names.index("left_hand"))[0])
    near = replace(near, own=replace(near.own, vertex=at))
    assert set(method.find_touch(given, near).kind[0, arm].unique().tolist()) == {-1}


def test_a_thigh_beside_the_thigh_of_another_does_not_sit(body, monkeypatch):
    one = alone(body)
    apart = torch.tensor([0.0, 0.0, 0.15])
    vertices, joints = (torch.cat([x, x + apart]) for x in (one.vertices, one.joints))
    both = one.select_people(torch.tensor([0, 0]))
    given = with_result(both, SimpleNamespace(vertices=vertices, joints=joints))
    always_touched(monkeypatch, 0.9)
    method = engine_preset("default").contact
    found = find_contact(given, near_of(given, method), method)
    thighs = torch.cat([body.contact_sets["thighs"], body.contact_sets["gluteus"]])
    touched = {
        found.partners[number].kind
        for number in found.partner[:, thighs].unique().tolist()
        if number >= 0
    }
    assert "person" in touched
    for support in found.supports:
        on_people = {one.part for one in support.contacts if one.partner.kind == "person"}
        assert not on_people & {"seat", "left_upper_leg", "right_upper_leg"}
