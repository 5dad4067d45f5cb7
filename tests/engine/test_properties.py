"""What holds for every input of the terms, not only for those worked out by hand."""

from __future__ import annotations

import roma
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from physic_core.engine.joint.sampling import root_relative
from physic_core.engine.joint.snapshot import signed_distance
from physic_core.engine.joint.terms.scene import sole_energy
from physic_core.geometry.plane import height_over_plane

SEEDS = st.integers(0, 2**31 - 1)
few = settings(max_examples=40, deadline=None)


def draw(seed, *shape, low=-1.0, high=1.0):
    generator = torch.Generator().manual_seed(seed)
    return low + (high - low) * torch.rand(shape, generator=generator, dtype=torch.float64)


@few
@given(SEEDS, st.floats(-2.0, 2.0))
def test_height_and_signed_distance_agree_on_a_plane(seed, offset):
    normal = torch.nn.functional.normalize(draw(seed, 3), dim=0)
    vertices = draw(seed + 1, 2, 6, 3)
    on_plane = draw(seed + 2, 2, 6, 3)
    on_plane = (
        on_plane - (height_over_plane(on_plane, normal, torch.tensor(offset)))[..., None] * normal
    )
    height = height_over_plane(vertices, normal, torch.tensor(offset))
    torch.testing.assert_close(
        signed_distance(vertices, on_plane, normal.expand_as(vertices)), height
    )


@few
@given(SEEDS)
def test_regularisation_does_not_see_where_a_body_is_and_how_it_is_turned(seed):
    vertices = draw(seed, 2, 6, 3)
    pelvis = draw(seed + 1, 2, 3)
    root = roma.rotvec_to_rotmat(3 * draw(seed + 2, 2, 3))
    turn = roma.rotvec_to_rotmat(3 * draw(seed + 3, 3))
    move = draw(seed + 4, 3)
    here = root_relative(vertices, pelvis, root)
    there = root_relative(vertices @ turn.T + move, pelvis @ turn.T + move, turn @ root)
    torch.testing.assert_close(here, there)


@few
@given(SEEDS, st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_only_the_lower_foot_is_pulled_from_afar(seed, left, right):
    lowest = torch.tensor([[left, right]], dtype=torch.float64, requires_grad=True)
    value = sole_energy(lowest, 1e-9 * torch.ones(1, 2).double(), torch.ones(1).double())
    value.sum().backward()
    lower = 0 if left <= right else 1
    if abs(left - right) > 1e-6 and abs(min(left, right)) > 1e-3:
        assert abs(lowest.grad[0, lower]) > 1e3 * abs(lowest.grad[0, 1 - lower])
    assert value.item() >= 0
