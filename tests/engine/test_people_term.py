"""People who touch each other: pulled together where they are near, and not inside each other."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch
from torch.testing import assert_close

from physic_core import engine_preset
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.solve import optimize
from physic_core.engine.joint.terms.people import (
    find_people_pairs,
    select_probes,
)
from physic_core.geometry.mesh import vertex_normals
from physic_core.geometry.robust import geman_mcclure, pseudo_huber

from .adjusted import adjusted, without_photo

DEFAULT = engine_preset("default").joint
REACH_M = 0.06


def add_people(energy):
    """The term as the preset adds it after the others."""
    return energy.add_terms(DEFAULT.late_terms(energy.sampling)[0])


def beside(make_stage, x, z):
    """Two people, 2 x metres beside and z metres behind each other, of whom the photo shows
    nothing.
    """
    stage = make_stage([({}, (-x, 0.0, 3.0)), ({}, (x, 0.0, 3.0 + z))])
    return replace(stage, state=without_photo(stage.state))


@pytest.fixture(scope="module")
def crossing(make_stage):
    """Two people with 6 cm of their arms inside each other."""
    return beside(make_stage, 0.15, 0.1)


def pair_energy(distance, apart, touch):
    """Energy of pairs by their distance: slack 5 mm, sigma 2 cm, outliers beyond 2 sigmas inside
    and 1.5 outside.
    """
    inside = torch.relu(-distance - 0.005) / 0.02
    gap = torch.relu(distance) / 0.02
    return apart * pseudo_huber(inside.square(), 2.0) + touch * geman_mcclure(gap.square(), 1.5)


def pairs_of(stage, vertices):
    model = stage.state.model
    ids = model.coarse.ids
    probes, _ = select_probes(model, ids, torch.ones(len(vertices), len(ids)))
    normals = vertex_normals(vertices, model.faces)[:, ids]
    found = find_people_pairs(probes, vertices[:, ids], normals, REACH_M)
    return probes, vertices[:, ids], normals, found


def test_the_term_has_the_values_and_gradients_of_its_equation(crossing):
    state = crossing.state
    energy = JointEnergy(state, settings(3.0, 0.8))
    assert add_people(energy) is not None
    people = energy.terms[-1]
    pairs = people.pairs
    vertices = energy.sampling.start.vertices[:, energy.sampling.ids].clone().requires_grad_()

    def reference(vertices):
        offset = vertices[pairs.person, pairs.row] - vertices[pairs.other, pairs.other_row]
        own = pair_energy((offset * pairs.normal).sum(-1), people.apart.weight, people.touch.weight)
        return torch.zeros(2).index_add(0, pairs.person, own)

    def term(vertices):
        return people(SimpleNamespace(vertices=vertices))["people"]

    found = term(vertices)
    expected = reference(vertices)
    assert people.touch.weight.gt(0).any()
    assert_close(found, expected)
    weight = torch.tensor([0.7, 1.3])
    assert_close(
        *(torch.autograd.grad((weight * value).sum(), vertices)[0] for value in (found, expected)),
        rtol=1e-4,
        atol=1e-4,
    )


def settings(inside, contact):
    return adjusted(
        DEFAULT,
        depth__weight=0.0,
        penetration__people_weight=inside,
        contact__people_weight=contact,
    )


def distances(stage, result):
    return pairs_of(stage, result.vertices)[3].distance


def test_people_inside_each_other_are_moved_apart(crossing):
    kept, moved = (optimize(crossing.state, settings(weight, 0.0)) for weight in (0.0, 3.0))
    assert distances(crossing, kept).min() < -0.05
    assert distances(crossing, moved).min() > -0.015
    assert "people" not in kept.joint.losses
    start, end = moved.joint.losses["people"]
    assert end < 0.01 * start


def test_visible_hands_near_a_person_touch_them_and_nothing_else_is_pulled(crossing):
    def touching(**changes):
        energy = JointEnergy(replace(crossing.state, **changes), settings(3.0, 0.8))
        assert add_people(energy) is not None
        people = energy.terms[-1]
        return people.pairs.select(people.touch.weight > 0), energy.sampling

    pairs, sampling = touching()
    model = crossing.state.model
    parts = {
        model.part_names[part] for part in model.part_of_vertex[sampling.ids[pairs.row]].tolist()
    }
    assert parts
    assert parts <= {"left_hand", "right_hand"}
    assert pairs.distance.max() < 0.04
    assert not len(touching(observed=torch.zeros(2, 55, dtype=torch.bool))[0])
