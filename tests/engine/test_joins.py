"""Hands that meet in the picture: joined if the other terms allow it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch

from physic_core import engine_preset
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.solve import optimize
from physic_core.engine.joint.terms.joins import JoinSettings, JoinTerm, find_joins
from physic_core.geometry.robust import pseudo_huber

from .adjusted import adjusted

DEFAULT = adjusted(engine_preset("default").joint, depth__weight=0.0)


def beside(make_stage, behind_m: float):
    """Two people whose hands meet in the picture, one of them behind the other, in front of nothing."""
    stage = make_stage([({}, (-0.36, 0.0, 3.0)), ({}, (0.36, 0.0, 3.0 + behind_m))])
    nothing = torch.zeros(0, 3)
    free = {"floor_normal": None, "scene_points": nothing, "scene_normals": nothing, "human_depth": None}
    return replace(stage, problem=replace(stage.problem, **free))


@pytest.fixture(scope="module")
def apart(make_stage):
    """Two people whose hands are 12 cm apart along the ray."""
    return beside(make_stage, 0.25)


def hand_gap_m(problem, vertices) -> float:
    """Distance of the first person's left hand from the second one's right hand."""
    part, names = problem.model.part_of_vertex, problem.model.part_names
    left, right = (part == names.index(f"{side}_hand") for side in ("left", "right"))
    return float(torch.cdist(vertices[0][left], vertices[1][right]).amin())


def joins_of(problem, **changes):
    """Joins that are found at the start, and the energy there."""
    energy = JointEnergy(problem.to_model_dtype(), DEFAULT)
    found = find_joins(replace(JoinSettings(), **changes), energy.context, energy.snapshot.vertices)
    return found, energy


def test_hands_that_meet_in_the_picture_are_joined(apart):
    without, joined = (optimize(apart.problem, adjusted(DEFAULT, joins__weight=w)) for w in (0.0, 4.0))
    assert hand_gap_m(apart.problem, without.vertices) == pytest.approx(0.12, abs=0.01)
    assert hand_gap_m(apart.problem, joined.vertices) < 0.01
    assert joined.reprojection_share.max() < 0.002
    assert joined.losses["joins"][1] < 0.2 < joined.losses["joins"][0]


@pytest.mark.parametrize("changes", [{"max_rise": 0.0}, {"width_m": 1e-3}, {"reach_m": 0.05}])
def test_a_join_that_is_rejected_or_not_tried_changes_nothing(apart, changes):
    without = optimize(apart.problem, adjusted(DEFAULT, joins__weight=0.0))
    other = optimize(apart.problem, adjusted(DEFAULT, **{f"joins__{name}": value for name, value in changes.items()}))
    assert torch.equal(other.vertices, without.vertices)
    assert other.losses == without.losses


def test_the_other_terms_reject_a_join(make_stage):
    """Both people have known depths, which a join within reach would contradict."""
    stage = make_stage([({}, (-0.36, 0.0, 3.0)), ({}, (0.36, 0.0, 3.25))])
    assert joins_of(stage.problem)[0]
    sure = adjusted(engine_preset("default").joint, depth__weight=1000.0, depth__offset_sigma=0.0)
    assert "joins" not in optimize(stage.problem, sure).losses


def test_limbs_are_joined_by_the_keypoints_that_the_photo_shows(apart):
    problem = apart.problem
    found, energy = joins_of(problem)
    assert [(join.person, join.other) for join in found] == [(0, 1)]
    parts = problem.model.part_of_vertex[energy.context.ids]
    names = problem.model.part_names
    assert {names[part] for part in parts[found[0].rows].tolist()} == {"left_hand"}
    assert {names[part] for part in parts[found[0].other_rows].tolist()} == {"right_hand"}
    hidden = problem.observed.clone()
    hidden[1] = False
    assert joins_of(replace(problem, observed=hidden))[0] == []


def test_a_hand_may_touch_a_knee_of_the_same_person_alone(apart):
    """The knees of both people are seen at the left hand of the first."""
    problem = apart.problem
    keypoints, names = problem.keypoints.clone(), problem.skeleton.names
    knees = [names.index(f"{side}_knee") for side in ("left", "right")]
    keypoints[:, knees] = keypoints[0, names.index("left_wrist")].clone()
    found, energy = joins_of(replace(problem, keypoints=keypoints), reach_m=1.0)
    parts = problem.model.part_of_vertex[energy.context.ids]
    limbs = [(join, problem.model.part_names[int(parts[join.other_rows[0]])]) for join in found]
    legs = [join for join, limb in limbs if limb.endswith("_leg")]
    assert legs
    assert all(join.person == join.other for join in legs)


def test_the_term_has_the_values_and_gradients_of_its_equation(apart):
    (join,), energy = joins_of(apart.problem)
    term = JoinTerm(JoinSettings(weight=1.5))
    assert term.links.shape == (0, 2)
    term.joins = (join,)
    term.refresh(energy.snapshot)
    assert term.links.tolist() == [[0, 1]]
    vertices = energy.snapshot.vertices.double().clone().requires_grad_()

    def value(vertices):
        return term(SimpleNamespace(vertices=vertices))["joins"]

    gap = torch.cdist(vertices[0, join.rows], vertices[1, join.other_rows]).amin()
    expected = 1.5 * pseudo_huber(gap.square() / 0.02**2, 2.0)
    torch.testing.assert_close(value(vertices), torch.stack([expected, torch.zeros_like(expected)]))
    of_pair = torch.autograd.grad(value(vertices)[0], vertices)[0]
    step = 1e-6 * of_pair / of_pair.norm()
    with torch.no_grad():
        slope = (value(vertices + step) - value(vertices - step))[0] / 2e-6
    torch.testing.assert_close(slope, of_pair.norm(), rtol=1e-6, atol=0.0)
    assert int((of_pair != 0).any(-1).sum()) == 2


def test_a_join_is_decided_among_the_people_who_touch(apart, make_stage):
    """A third person far away changes neither the others nor themselves."""
    three = make_stage([({}, (-0.36, 0.0, 3.0)), ({}, (0.36, 0.0, 3.25)), ({}, (3.0, 0.0, 6.0))])
    two = apart.problem
    free = {name: getattr(two, name) for name in ("floor_normal", "scene_points", "scene_normals", "human_depth")}
    settings = adjusted(DEFAULT, frozen=("scale",))
    pair, everybody = (optimize(p, settings) for p in (two, replace(three.problem, **free)))
    without = optimize(replace(three.problem, **free), adjusted(settings, joins__weight=0.0))
    assert everybody.losses["joins"][1] == pytest.approx(pair.losses["joins"][1], abs=0.02)
    assert hand_gap_m(two, everybody.vertices) < 0.01
    assert torch.equal(everybody.vertices[2], without.vertices[2])


def test_the_energy_of_some_people_is_their_part_of_that_of_all(make_stage):
    problem = make_stage([({}, (-0.5, 0.0, 3.0)), ({}, (0.5, 0.0, 3.2)), ({}, (1.5, 0.0, 4.0))]).problem
    energy, rows = JointEnergy(problem.to_model_dtype(), DEFAULT), torch.tensor([2, 0])
    with torch.no_grad():
        for group, value in energy.state.values.items():
            if group != "scale":
                value += 0.01
        energy.refresh()
        of_all, of_some = energy(), energy.of_people(rows)()
    assert of_all.keys() <= of_some.keys()
    for name in of_all.keys() - {"scale"}:
        torch.testing.assert_close(of_some[name], of_all[name][rows], rtol=1e-6, atol=1e-9, msg=name)
