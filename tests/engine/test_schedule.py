"""When terms join the joint optimisation."""

from __future__ import annotations

from dataclasses import replace

import pytest
import roma
import torch

from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.schedule import minimise_with_schedule
from physic_core.engine.joint.solve import optimize
from physic_core.engine.presets import PRESETS
from physic_core.engine.presets.default import DefaultOptimisation

from .adjusted import adjusted

JOINT = PRESETS["default"].joint


class Late(DefaultOptimisation):
    """Preset "default" whose scene joins after half of the steps, as PROX's does."""

    scene_start_share = 0.5


LATE = Late()


@pytest.fixture(scope="module")
def two(make_stage):
    return make_stage([({}, (-0.6, 0.0, 3.5)), ({}, (0.5, 0.0, 4.2))])


def tilted(problem, degrees):
    """Bodies turned about the camera's horizontal axis, each about its pelvis, by so many degrees."""
    turns = torch.zeros(len(problem), 3)
    turns[:, 0] = torch.deg2rad(torch.tensor(degrees))
    rotations = problem.rotations0.clone()
    rotations[:, 0] = roma.rotvec_to_rotmat(turns) @ rotations[:, 0]
    return replace(problem, rotations0=rotations)


def error_mm(result, stage):
    return 1e3 * (result.vertices - stage.vertices).norm(dim=-1).mean(1)


def test_the_result_is_the_minimum_of_the_energy(two):
    problem = tilted(two.problem, (5.0, -5.0))
    settings = adjusted(JOINT, optimiser__steps=20)
    energy = JointEnergy(problem, settings)
    trace = minimise_with_schedule(energy, settings)
    assert torch.equal(optimize(problem, settings).transl, energy.state.unpack().transl)
    assert trace.steps == 20


def test_the_scene_joins_late(two):
    """Put 6 cm too low, people stay in the floor until contact and floor join."""
    problem = replace(two.problem, transl0=two.problem.transl0 + torch.tensor([0.0, 0.06, 0.0]))
    late = adjusted(LATE, optimiser__steps=30, optimiser__refresh_steps=15)
    result = optimize(problem, late)
    assert error_mm(result, two).amax() < 10
    assert {"contact", "floor", "soles", "penetration"} <= set(result.losses)
    told: list[float] = []
    optimize(problem, adjusted(late, optimiser__steps=8, optimiser__refresh_steps=2), told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_late_scene_reports_losses_from_the_true_start(two):
    problem = replace(two.problem, transl0=two.problem.transl0 + torch.tensor([0.0, 0.06, 0.0]))
    late = optimize(problem, adjusted(LATE, optimiser__steps=20, optimiser__refresh_steps=10))
    at_once = optimize(problem, adjusted(JOINT, optimiser__steps=20, optimiser__refresh_steps=10))
    assert late.losses["floor"][0] == pytest.approx(at_once.losses["floor"][0], rel=0.05)
    assert late.losses["floor"][1] < 0.2 * late.losses["floor"][0]
