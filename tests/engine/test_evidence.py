"""What a run holds fixed and what the photo shows: thinning, limbs, keypoints, clouds."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from physic_core import engine_preset
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.snapshot import sample_mask_neighbours
from physic_core.geometry.visibility import inside_mask
from physic_paper.terms.chamfer import HumanPoints

from .adjusted import adjusted, shifted
from .drawn import uniform

SETTINGS = engine_preset("default").joint


def test_thinning_changes_the_energy_little(standing):
    state = shifted(standing.state, 0.0, 0.04, 0.0)
    every = adjusted(SETTINGS, visibility__vertex_spacing_m=0.0)
    thin, full = (JointEnergy(state, settings)() for settings in (SETTINGS, every))
    for name in ("contact", "floor", "soles"):
        assert thin[name].item() == pytest.approx(full[name].item(), rel=0.05), name


def test_chamfer_equals_its_slow_reference_under_a_scale(standing):
    state = standing.state
    cloud = HumanPoints.of_state(state)
    vertices = standing.vertices[:, ::7] + torch.tensor([0.01, 0.0, 0.05])
    facing = uniform(*vertices.shape[:2]) < 0.5
    log_scale = torch.tensor(0.1)
    points = cloud.points[0].double() * log_scale.exp()
    seen = vertices[0, facing[0]].double()
    pairs = torch.cdist(seen, points, compute_mode="donot_use_mm_for_euclid_dist")
    want = pairs.amin(1).square().sum() + pairs.amin(0).square().sum()
    assert cloud(vertices, facing, log_scale).item() == pytest.approx(want.item(), rel=1e-4)


@given(seed=st.integers(0, 2**16), reach=st.floats(0, 30))
def test_masks_are_sampled_at_a_pixel_and_eight_neighbours(seed, reach):
    uv = uniform(2, 50, 2, seed=seed) * torch.tensor([60.0, 50.0]) - 10
    uv[0, 0] = torch.nan
    masks = uniform(2, 30, 40, seed=seed) > 0.5
    reaches = reach * uniform(2, seed=seed)
    steps = [torch.tensor([x, y]) for y in (-1.0, 0.0, 1.0) for x in (-1.0, 0.0, 1.0)]
    plain = torch.stack([inside_mask(uv + step * reaches[:, None, None], masks) for step in steps])
    assert torch.equal(sample_mask_neighbours(uv, masks, reaches), plain)
