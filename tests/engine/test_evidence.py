"""What a run holds fixed and what the photo shows: thinning, limbs, keypoints, clouds."""

from __future__ import annotations

import pytest
import torch

from physic_core import engine_preset
from physic_core.engine.joint.energy import JointEnergy
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
    cloud = HumanPoints.from_state(state)
    vertices = standing.vertices[:, ::7] + torch.tensor([0.01, 0.0, 0.05])
    facing = uniform(*vertices.shape[:2]) < 0.5
    log_scale = torch.tensor(0.1)
    points = cloud.points[0].double() * log_scale.exp()
    seen = vertices[0, facing[0]].double()
    pairs = torch.cdist(seen, points, compute_mode="donot_use_mm_for_euclid_dist")
    want = pairs.amin(1).square().sum() + pairs.amin(0).square().sum()
    assert cloud(vertices, facing, log_scale).item() == pytest.approx(want.item(), rel=1e-4)
