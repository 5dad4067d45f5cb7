"""The contact of people who are near no scene: with skin, by what an observer says."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from physic_core import engine_preset
from physic_core.engine.contact.distances import ContactSurfaces
from physic_core.engine.contact.solve import find_contact, measure_distances
from physic_core.geometry.neighbors import NearestPointSearch
from physic_core.types import SKELETONS, TOUCH_PARTS, TOUCHED, Intrinsics

from .adjusted import with_result
from .conftest import state_of
from .touching import touching


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


def beside(body, gap, **parts):
    """Two people, one behind the other, of whose parts the observer says the same."""
    one = alone(body)
    apart = torch.tensor([0.0, 0.0, gap])
    vertices, joints = (torch.cat([x, x + apart]) for x in (one.vertices, one.joints))
    both = one.select_people(torch.tensor([0, 0]))
    given = with_result(both, SimpleNamespace(vertices=vertices, joints=joints))
    return replace(given, observed_touch=torch.tensor(np.repeat(touching(**parts), 2, 0)))


def contact_of(given):
    method = engine_preset("default").contact
    return find_contact(given, near_of(given, method), method)


@pytest.mark.parametrize(("probability", "touches"), [(0.9, True), (0.1, False)])
def test_who_is_touched_touches_back(body, probability, touches):
    one, other = contact_of(beside(body, 0.15, left_hand=("person", probability))).contacts
    given, returned = (
        {(c.part, c.partner.part, c.probability) for c in person if c.partner.kind == "person"}
        for person in (one, other)
    )
    assert bool(given) is touches
    assert {(b, a, p) for a, b, p in given} == returned


def test_a_part_that_meets_skin_has_the_rest_of_its_probability_for_what_else_it_touches(body):
    given = beside(body, 0.15, left_hand=("person", 0.4))
    given.observed_touch[..., TOUCH_PARTS.index("left_hand"), TOUCHED.index("object")] = 0.6
    for contacts in contact_of(given).contacts:
        kinds = {one.partner.kind: one.probability for one in contacts if one.part == "left_hand"}
        assert kinds.keys() == {"person"}
        assert kinds["person"] > 0.6


def test_skin_of_which_the_observer_does_not_speak_touches_nobody(body):
    found = contact_of(beside(body, 0.15))
    assert not {p.kind for p in found.partners} & {"person", "self"}


def test_parts_that_meet_at_a_joint_do_not_touch(body):
    given = replace(
        alone(body), observed_touch=torch.tensor(touching(left_forearm=("own body", 0.9)))
    )
    assert not {p.part for p in contact_of(given).partners} & {"left_hand", "left_upper_arm"}
