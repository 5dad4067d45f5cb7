"""Hands that the photo shows on another person: the two move along the rays until they touch."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.people_pairs import connected_groups
from physic_core.engine.joint.reaching_hands import Hand, find_reaches, meeting_pairs
from physic_core.engine.joint.solve import optimize
from physic_core.engine.joint.terms.reach import reach_energy
from physic_core.engine.presets import PRESETS

from .adjusted import adjusted
from .test_people_term import beside

DEFAULT = PRESETS["default"].joint
NONE = torch.zeros(0, dtype=torch.int64)


def settings(weight: float):
    return adjusted(DEFAULT, depth__weight=0.0, restarts=1, contact__people_weight=weight)


@pytest.fixture(scope="module")
def in_front(make_stage):
    """Two people with stretched arms, 80 cm beside and 25 cm behind each other: a hand is before the other's chest."""
    return beside(make_stage, 0.4, 0.25)


def late_energy(problem) -> JointEnergy:
    energy = JointEnergy(problem, settings(0.8))
    energy.add_late_terms()
    return energy


def test_energy_is_quadratic_near_contact_and_bounded_far_from_it():
    apart, share = torch.tensor([0.0, 0.05, -0.05, 10.0]).double(), torch.tensor([1.0, 1.0, 0.5, 2.0]).double()
    assert reach_energy(apart, share).tolist() == pytest.approx([0.0, 0.9, 0.45, 18.0], rel=1e-3)


def test_gradient_of_the_energy_is_exact():
    apart = torch.tensor([-0.2, -0.01, 0.04, 0.3], dtype=torch.float64, requires_grad=True)
    share = torch.tensor([0.3, 1.0, 2.0, 0.7], dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda a: reach_energy(a, share), apart)


def test_a_hand_meets_the_vertex_that_is_nearest_in_depth_at_its_pixel():
    hand, behind = [0.0, 0.0, 2.0], [0.0, 0.0, 2.2]
    first, beside_it = [0.005, 0.0, 2.1], [0.1, 0.0, 2.05]
    vertices = torch.tensor([[hand] * 3, [behind, first, beside_it]]).double()
    hands = [Hand(0, torch.tensor([0]), NONE, NONE)]
    (reach,) = find_reaches(hands, vertices, 0.04, 0.25)
    pairs = meeting_pairs([reach], vertices)
    assert (pairs.person.tolist(), pairs.other.tolist(), pairs.other_row.tolist()) == ([0], [1], [1])
    assert pairs.share.tolist() == [1.0]
    assert find_reaches(hands, vertices, 0.04, 0.09) == []


def test_people_who_touch_and_hands_that_rest_on_the_own_body_reach_nobody():
    vertices = torch.tensor([[[0.0, 0.0, 2.0], [0.0, 0.5, 2.0]], [[0.0, 0.0, 2.1], [1.0, 0.5, 2.0]]]).double()
    hand, rest = torch.tensor([0]), torch.tensor([1])
    free = Hand(0, hand, rest, NONE)
    assert len(find_reaches([free], vertices, 0.04, 0.25)) == 1
    touching = vertices.clone()
    touching[1, 1] = vertices[0, 1]
    assert find_reaches([free], touching, 0.04, 0.25) == []
    resting = vertices.clone()
    resting[0, 1, 1] = 0.03
    assert find_reaches([free], resting, 0.04, 0.25) == []
    assert len(find_reaches([Hand(0, hand, rest, hand)], resting, 0.04, 0.25)) == 1  # onto the other's hand


def test_a_hand_before_a_person_ends_on_that_person(in_front):
    apart, touching = (optimize(in_front.problem, settings(weight)) for weight in (0.0, 0.8))

    def gap(result) -> float:
        model = in_front.problem.model
        hand = result.vertices[0, model.part_of_vertex == model.part_names.index("left_hand")]
        return float(torch.cdist(hand, result.vertices[1, model.outer]).amin())

    assert gap(apart) > 0.08
    assert gap(touching) < 0.02
    assert touching.losses["reach"][1] < 0.1 * touching.losses["reach"][0]
    error = (touching.vertices - apart.vertices)[..., :2].norm(dim=-1)
    assert error.max() < 0.05  # the motion is along the rays


def test_hidden_hands_reach_nobody(in_front):
    assert "reach" in late_energy(in_front.problem)()
    unseen = replace(in_front.problem, observed=torch.zeros(2, 55, dtype=torch.bool))
    assert "reach" not in late_energy(unseen)()


def test_people_are_grouped_by_their_links():
    links = torch.tensor([[3, 1], [1, 4], [4, 3], [0, 2]])
    assert connected_groups(links, 6).tolist() == [0, 1, 0, 1, 1, 5]
    assert connected_groups(links[:0], 2).tolist() == [0, 1]
