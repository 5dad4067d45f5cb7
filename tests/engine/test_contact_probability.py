"""The probability of contact: the fitted file, the logistic model, and the gap that vertices of a
part share.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from physic_core import engine_preset
from physic_core.engine.contact.distances import KINDS, ContactSurfaces
from physic_core.engine.contact.probability import ContactModel, part_gaps
from physic_core.engine.contact.solve import contact_of, measure_distances
from physic_core.geometry.neighbors import NearestPointSearch
from physic_core.types import SKELETONS, Intrinsics

from .conftest import state_of

LINEAR = ContactModel(
    {"own body": {"constant": 1.0, "outside": -2.0}}, {"constant": -0.5, "log odds": 1.0}, {}
)
OWN_BODY = KINDS.index("own body")


@given(st.floats(0, 3))
def test_the_log_odds_of_a_vertex_are_the_weighted_sum_of_its_features(outside):
    columns = {"own body": {"constant": torch.ones(1, 1), "outside": torch.full((1, 1), outside)}}
    found = LINEAR.probabilities(columns)
    assert found.shape == (len(KINDS), 1, 1)
    assert float(found[OWN_BODY, 0, 0]) == pytest.approx(
        1 / (1 + math.exp(2 * outside - 1)), rel=1e-4
    )
    assert int(found.count_nonzero()) == 1


def test_skin_is_touched_less_often_in_photos_than_in_worlds():
    in_worlds = 1 / (1 + math.exp(0.5))
    found = [LINEAR.part_probability(torch.full((3,), p)) for p in (0.5, 0.9)]
    assert 0 < found[0] < in_worlds
    assert found[0] < found[1]


def test_the_gap_of_a_part_is_its_fifth_smallest_distance():
    distance = torch.tensor([[0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.5, 0.4, math.inf]])
    group = torch.tensor([[0, 0, 0, 0, 0, 0, 1, 1, 1]])
    gaps = part_gaps(distance, group)[0]
    assert gaps[:6].tolist() == pytest.approx([0.05] * 6)
    assert gaps[6:].tolist() == [0.5, 0.5, math.inf]


def alone(body, plane=None, stance=None):
    """A person in the rest pose who is near no point of a scene."""
    posed = body(*body.zero_pose())
    return state_of(
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
        stance=stance,
        vertices=posed.vertices,
        joints=posed.joints,
    )


def near_of(state, method):
    """Distances of people who are near no point of a scene."""
    empty = NearestPointSearch(torch.zeros(0, 3), torch.zeros(0, 3))
    none = torch.zeros(0, dtype=torch.int64)
    surfaces = ContactSurfaces(empty, none, state.scene.floor_plane)
    return measure_distances(state, surfaces, (("unknown",), none), method)


def test_up_is_that_of_an_upright_camera_without_a_floor(body):
    assert alone(body).up.tolist() == [0.0, -1.0, 0.0]


@pytest.mark.parametrize(("scene", "kind"), [(0.1, OWN_BODY), (0.9, -1)])
def test_skin_is_touched_only_where_it_is_likelier_than_the_scene(body, monkeypatch, scene, kind):
    soles = float(body(*body.zero_pose()).vertices[..., 1].min())
    given = alone(body, plane=(torch.tensor([0.0, 1.0, 0.0]), -soles))
    settings = replace(engine_preset("default").contact, threshold=0.999, skin_threshold=0.1)
    near = near_of(given, settings)
    near = replace(near, own=replace(near.own, distance=torch.zeros_like(near.own.distance)))
    model = ContactModel({"own body": {"constant": -1.5}}, LINEAR.part, {})
    on_floor = torch.isfinite(near.surface.nearest) & body.outer
    assert on_floor.any()
    likely = torch.full_like(near.surface.scene, scene), {}
    monkeypatch.setattr("physic_core.engine.contact.method.contact_model", lambda: model)
    monkeypatch.setattr(
        "physic_core.engine.contact.method.scene_contact", lambda given, near: likely
    )
    monkeypatch.setattr("physic_core.engine.contact.method.contact_parts", lambda body: {})
    assert settings.touch(given, near).kind[on_floor].unique().tolist() == [kind]


def test_a_thigh_beside_the_thigh_of_another_does_not_sit(body):
    one = alone(body)
    apart = torch.tensor([0.0, 0.0, 0.15])
    given = replace(
        one.select_people(torch.tensor([0, 0])),
        vertices=torch.cat([one.vertices, one.vertices + apart]),
        joints=torch.cat([one.joints, one.joints + apart]),
    )
    method = replace(engine_preset("default").contact, skin_threshold=0.0)
    found = contact_of(given, near_of(given, method), method)
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
