"""What holds for every input of the terms, not only for those worked out by hand."""

from __future__ import annotations

from functools import partial

import roma
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from physic_core.engine.distances import root_relative, signed_distance
from physic_core.engine.joint.terms.soles import sole_energy
from physic_core.geometry.plane import height_over_plane
from physic_core.geometry.robust import cauchy, geman_mcclure, pseudo_huber

from .reference_energies import contact_energy, penetration_energy

SEEDS = st.integers(0, 2**31 - 1)
few = settings(max_examples=40, deadline=None)


def draw(seed, *shape, low=-1.0, high=1.0):
    generator = torch.Generator().manual_seed(seed)
    return low + (high - low) * torch.rand(shape, generator=generator, dtype=torch.float64)


@few
@given(SEEDS, st.floats(0.0, 0.05))
def test_nothing_outside_penetrates_and_deeper_costs_more(seed, slack):
    signed, weight = draw(seed, 3, 8, low=-0.2, high=0.2), draw(seed + 1, 3, 8, low=0)
    rho = partial(pseudo_huber, c=2.0)
    assert penetration_energy(signed.abs(), weight, slack, 0.02, rho).eq(0).all()
    shallow = penetration_energy(signed, weight, slack, 0.02, rho)
    deep = penetration_energy(signed - 0.01, weight, slack, 0.02, rho)
    assert (deep >= shallow).all()


@few
@given(SEEDS)
def test_contact_is_the_same_on_either_side_and_bounded_where_it_lets_go(seed):
    distance, weight = draw(seed, 2, 9), draw(seed + 1, 2, 9, low=0)
    rho = partial(geman_mcclure, c=3.0)
    one, other = (contact_energy((d / 0.02).square(), weight, rho) for d in (distance, -distance))
    assert torch.equal(one, other)
    assert (one <= 9.0 * weight.sum(-1) + 1e-9).all()


@few
@given(SEEDS, st.floats(-2.0, 2.0))
def test_height_and_signed_distance_agree_on_a_plane(seed, offset):
    normal = torch.nn.functional.normalize(draw(seed, 3), dim=0)
    vertices = draw(seed + 1, 2, 6, 3)
    on_plane = draw(seed + 2, 2, 6, 3)
    on_plane = on_plane - (height_over_plane(on_plane, normal, torch.tensor(offset)))[..., None] * normal
    height = height_over_plane(vertices, normal, torch.tensor(offset))
    torch.testing.assert_close(signed_distance(vertices, on_plane, normal.expand_as(vertices)), height)


@few
@given(SEEDS)
def test_regularisation_does_not_see_where_a_body_is_and_how_it_is_turned(seed):
    vertices, pelvis = draw(seed, 2, 6, 3), draw(seed + 1, 2, 3)
    root = roma.rotvec_to_rotmat(3 * draw(seed + 2, 2, 3))
    turn, move = roma.rotvec_to_rotmat(3 * draw(seed + 3, 3)), draw(seed + 4, 3)
    here = root_relative(vertices, pelvis, root)
    there = root_relative(vertices @ turn.T + move, pelvis @ turn.T + move, turn @ root)
    torch.testing.assert_close(here, there)


@few
@given(SEEDS, st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_only_the_lower_foot_is_pulled_from_afar(seed, left, right):
    lowest = torch.tensor([[left, right]], dtype=torch.float64, requires_grad=True)
    far = partial(cauchy, c=0.1)
    value = sole_energy(lowest, 1e-9 * torch.ones(1, 2).double(), torch.ones(1).double(), far, far)
    value.sum().backward()
    lower = 0 if left <= right else 1
    if abs(left - right) > 1e-6 and abs(min(left, right)) > 1e-3:
        assert abs(lowest.grad[0, lower]) > 1e3 * abs(lowest.grad[0, 1 - lower])
    assert value.item() >= 0
