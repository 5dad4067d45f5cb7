"""The probability of contact with scene and skin, and the gap that vertices of a part share."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from physic_core import engine_preset
from physic_core.engine.contact.distances import KINDS, ContactSurfaces
from physic_core.engine.contact.probability import contact_part_masks
from physic_core.engine.contact.solve import find_contact, measure_distances
from physic_core.engine.ground.touch import (
    HAND,
    INSIDE,
    OUTSIDE,
    OWN_BODY,
    SKIN,
    touch_model,
)
from physic_core.geometry.neighbors import NearestPointSearch
from physic_core.types import SKELETONS, Intrinsics

from .adjusted import with_result
from .conftest import state_of


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


def always_touched(monkeypatch, probability):
    """Let skin touch what is near it with a probability."""
    constant = math.log(probability / (1 - probability))
    nothing = dict.fromkeys((OUTSIDE, INSIDE, HAND, OWN_BODY), 0.0)
    monkeypatch.setitem(touch_model(), SKIN, {"constant": constant, **nothing})


@pytest.mark.parametrize(
    ("part", "met", "touches"),
    [
        ("left_lower_arm", "left_hand", False),
        ("left_lower_arm", "right_hand", True),
        ("left_lower_arm", "left_lower_leg", True),
        ("left_upper_leg", "right_upper_leg", False),
    ],
)
def test_parts_touch_unless_they_meet_in_many_poses(body, monkeypatch, part, met, touches):
    given = alone(body)
    method = engine_preset("default").contact
    near = near_of(given, method)
    always_touched(monkeypatch, 0.99)
    skin = contact_part_masks(body)[part]
    at = int((body.part_of_vertex == body.part_names.index(met)).nonzero()[0])
    on_it = torch.where(skin, 0.0, torch.inf)[None]
    own = replace(near.own, distance=on_it, vertex=torch.full_like(near.own.vertex, at))
    kinds = set(method.find_touch(given, replace(near, own=own)).kind[0, skin].unique().tolist())
    assert (KINDS.index("own body") in kinds) == touches


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
