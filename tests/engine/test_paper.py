"""Preset "paper" does what the paper prints: stage 3 moves, and its terms are the printed ones."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch.testing import assert_close

from physic_core import engine_preset
from physic_core.engine.joint.energy import JointEnergy
from physic_core.geometry.camera import project
from physic_core.geometry.rotvecs import rotvec_to_rotmat
from physic_paper.terms.reprojection import confidence_weights

from .adjusted import adjusted, with_points, with_scene
from .drawn import normal

PAPER = engine_preset("paper").joint


def floor_grid(state):
    x, z = torch.meshgrid(torch.linspace(-2, 2, 81), torch.linspace(0.3, 6, 115), indexing="ij")
    height = torch.full_like(x, state.scene.floor.offset)
    return with_scene(state, floor_points=torch.stack([x, height, z], -1).reshape(-1, 3))


@pytest.fixture(scope="module")
def start(two):
    """Two people whose joints and places are off, and whose keypoints have errors of two pixels."""
    turns = 0.05 * normal(2, 55, 3).float()
    state = floor_grid(two.state)
    return replace(
        state,
        rotations=state.rotations @ rotvec_to_rotmat(turns),
        transl=state.transl + torch.tensor([[0.03, -0.04, 0.1], [-0.02, 0.03, -0.1]]),
        keypoints=state.keypoints + 2 * normal(*state.keypoints.shape, seed=1).float(),
    )


@pytest.mark.parametrize("reduction", ["sum", "mean"])
def test_reprojection_is_the_sum_or_the_mean_over_keypoints(start, reduction):
    energy = JointEnergy(start, adjusted(PAPER, reprojection__reduction=reduction))
    with torch.no_grad():
        posed = start.model(start.rotations, start.betas, start.transl, start.expression)
        seen = project(start.model.landmarks(posed, start.skeleton), start.K)
        weight = confidence_weights(start)
        if reduction == "mean":
            weight = weight / weight.sum(-1, keepdim=True)
        size = torch.tensor(start.masks.shape[:0:-1])
        off = ((seen - start.keypoints) / size).square().sum(-1)
        want = 10_000 * (weight * off).sum(-1)
        assert_close(energy()["reprojection"], want, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("visible", [0.0, 1.0])
def test_hidden_vertices_are_regularised_more_than_visible_ones(behind_box, visible):
    energy = JointEnergy(
        floor_grid(behind_box.state), adjusted(PAPER, regularisation__visible_weight=visible)
    )
    weight = energy.weights["regularisation"]
    hidden = energy.snapshot.visibility.hidden | ~energy.snapshot.visibility.eligible
    assert 0.2 < hidden.float().mean() < 0.95
    assert weight[~hidden].unique().tolist() == [visible]
    assert weight[hidden].unique().tolist() == [12.0]


def test_contact_outside_the_picture_counts(make_stage):
    """So near that the picture cuts the feet off, which stand on the samples of the floor."""
    stage = make_stage([({}, (0.0, 0.0, 1.8))])
    energy = JointEnergy(floor_grid(stage.state), PAPER)
    soles = torch.cat(energy.sampling.soles)
    assert not energy.snapshot.visibility.eligible[0, soles].any()
    assert (energy.weights["contact"][0, soles] > 0).float().mean() > 0.9


def test_penetration_looks_as_far_as_a_metre(standing):
    """A wall 40 cm before the person, of whom all is shown: they are inside of it, as printed."""
    v, u = torch.meshgrid(
        torch.linspace(-1.2, 1.2, 60), torch.linspace(-1.2, 1.2, 60), indexing="ij"
    )
    wall = torch.stack([u, v, torch.full_like(u, 3.1)], -1).reshape(-1, 3)
    normals = torch.tensor([0.0, 0.0, -1.0]).expand_as(wall)
    state = with_scene(with_points(standing.state, wall, normals), floor=None)
    with torch.no_grad():
        far, near = (
            JointEnergy(state, adjusted(PAPER, penetration__max_depth_m=reach))()["penetration"]
            for reach in (1.0, 0.15)
        )
    assert far > 10
    assert near == 0
