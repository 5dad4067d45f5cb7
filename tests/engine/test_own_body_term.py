"""Hands at the own body: pulled onto it where the photo shows them, and not inside it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch

from physic_core.body.joints import JOINT_NAMES
from physic_core.engine.contact.skin import own_distances
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.own_hands import OwnHand, find_own_pairs
from physic_core.engine.joint.solve import optimize
from physic_core.engine.joint.terms.own_body import OwnBodyTerm
from physic_core.engine.joint.terms.people import pair_energy
from physic_core.engine.presets import PRESETS
from physic_core.geometry.mesh import vertex_normals

from .adjusted import adjusted, without_photo

FINGERS = ("index", "middle", "pinky", "ring", "thumb")
DEFAULT = PRESETS["default"].joint
ARMS = ("shoulder", "elbow", "wrist", *(f"{finger}{i}" for finger in FINGERS for i in (1, 2, 3)))
TOWARDS, AWAY = [0.0, 0.0, -1.0], [0.0, 0.0, 1.0]


def settings(inside: float = 3.0, contact: float = 0.8):
    return adjusted(
        DEFAULT, depth__weight=0.0, restarts=1, penetration__people_weight=inside, contact__people_weight=contact
    )


def pairs_of(gap: float, *, on_thigh: bool = False, touches: bool = True, thigh_gap_m: float = 0.015):
    """Pairs of four vertices of a hand, ``gap`` metres and more before a patch of skin."""
    hand = [[0.0, 0.0, 1.0 - gap], [0.01, 0.0, 1.0 - gap], [0.02, 0.0, 0.99 - gap], [0.03, 0.0, 0.96 - gap]]
    skin = [[0.01 * i, 0.0, 1.0] for i in range(4)]
    one = OwnHand(
        0, touches, torch.arange(4), torch.arange(4), torch.arange(4, 8), torch.full((4,), on_thigh), thigh_gap_m
    )
    normals = torch.tensor([[AWAY] * 4 + [TOWARDS] * 4]).double()
    return find_own_pairs([one], torch.tensor([hand + skin]).double(), normals)


@pytest.mark.parametrize("gap", [-0.005, 0.005, 0.035])
def test_the_skin_of_a_hand_that_is_nearest_to_the_body_touches(gap):
    pairs, touches = pairs_of(gap)
    assert touches.tolist() == [True] * 3
    assert pairs.row.tolist() == [0, 1, 2]
    assert pairs.other_row.tolist() == [4, 5, 6]
    assert pairs.distance.tolist() == pytest.approx([gap, gap, gap + 0.01])


def test_hands_that_hang_and_hands_over_the_thigh_are_kept_out_alone():
    assert pairs_of(0.01, touches=False)[1].tolist() == [False] * 3
    assert pairs_of(0.0, on_thigh=True)[1].tolist() == [True] * 3
    assert pairs_of(0.0, on_thigh=True, thigh_gap_m=-1.0)[1].tolist() == [False] * 3
    assert pairs_of(0.03, on_thigh=True) is None
    assert pairs_of(0.06) is None
    assert pairs_of(0.2) is None


@pytest.fixture(scope="module")
def at_chest(make_stage):
    """A person with a bent arm, whose hand is 3 cm before the chest; the photo shows no more than this."""
    problem = make_stage(
        [({"left_shoulder": (0.6, -0.3, -1.2), "left_elbow": (0.0, -2.0, 0.0)}, (0.0, 0.0, 3.0))]
    ).problem
    return without_photo(problem)


def gap_of(problem, vertices) -> float:
    """Distance of the hand's fifth nearest vertex to the torso, metres."""
    body = problem.model
    rest = body(*body.zero_pose(1)).vertices[0]
    own = own_distances(vertices, vertex_normals(vertices, body.faces), body.outer, body.part_of_vertex, rest, 0.12)
    hand = body.part_of_vertex == body.part_names.index("left_hand")
    return float(own.distance[0, hand].kthvalue(5).values)


def test_a_visible_hand_ends_on_the_chest_and_nothing_but_arms_moves(at_chest):
    kept, pulled = (optimize(at_chest, settings(contact=weight)) for weight in (0.0, 0.8))
    assert gap_of(at_chest, kept.vertices) == pytest.approx(0.032, abs=0.003)
    assert abs(gap_of(at_chest, pulled.vertices)) < 0.012
    arms = torch.tensor([name.endswith(ARMS) for name in JOINT_NAMES])
    assert not torch.equal(pulled.rotations[:, arms], kept.rotations[:, arms])
    assert torch.equal(pulled.rotations[:, ~arms], kept.rotations[:, ~arms])
    assert torch.equal(pulled.transl, kept.transl)
    assert pulled.scene_scale == kept.scene_scale


def test_a_hand_that_the_photo_does_not_show_stays(at_chest):
    hidden = replace(at_chest, observed=torch.zeros(1, 55, dtype=torch.bool))
    kept, pulled = (optimize(hidden, settings(contact=weight)) for weight in (0.0, 0.8))
    assert torch.equal(kept.vertices, pulled.vertices)


def test_the_term_has_the_values_and_gradients_of_its_equation(at_chest):
    problem = replace(at_chest, model=at_chest.model.to(dtype=torch.float64)).to_model_dtype()
    energy = JointEnergy(problem, settings())
    assert energy.add_arm_terms()
    term = energy.terms[-1]
    assert isinstance(term, OwnBodyTerm)
    pairs = term.pairs
    vertices = energy.context.start.vertices[:, energy.context.ids].clone().requires_grad_()

    def reference(vertices):
        offset = vertices[0, pairs.row] - vertices[0, pairs.other_row]
        return pair_energy((offset * pairs.normal).sum(-1), term._apart.weight, term._touch.weight).sum()

    found, expected = term(SimpleNamespace(vertices=vertices))["own_body"].sum(), reference(vertices)
    assert vertices.dtype == torch.float64
    assert term._touch.weight.gt(0).any()
    torch.testing.assert_close(found, expected)
    torch.testing.assert_close(*(torch.autograd.grad(value, vertices)[0] for value in (found, expected)))


def test_a_person_who_does_not_touch_the_own_body_takes_no_further_step(make_stage):
    spread = {"left_shoulder": (0.0, 0.0, 0.0), "right_shoulder": (0.0, 0.0, 0.0)}
    problem = make_stage([(spread, (0.0, 0.0, 3.0))]).problem
    off, on = (optimize(problem, settings(weight, weight)) for weight in (0.0, 1.0))
    assert on.steps == off.steps
    assert torch.equal(on.vertices, off.vertices)
