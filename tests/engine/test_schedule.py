"""Where the joint optimisation starts, and when the scene joins."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import roma
import torch

from physic_core.engine.joint import schedule
from physic_core.engine.joint.acceptance import total_energy
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.schedule import minimise_with_restarts, select_start_poses
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


def test_one_start_is_the_plain_way(two):
    problem = tilted(two.problem, (5.0, -5.0))
    settings = adjusted(JOINT, optimiser__steps=20)
    energy = JointEnergy(problem, settings)
    trace = minimise_with_restarts(energy, settings)
    assert torch.equal(optimize(problem, settings).transl, energy.state.unpack().transl)
    assert trace.steps == 20


def test_nobody_who_is_sure_costs_another_start(two, monkeypatch):
    monkeypatch.setattr(schedule, "RESTART_ERROR", 0.02)
    settings = adjusted(JOINT, optimiser__steps=20, restarts=5)
    energy = JointEnergy(two.problem, settings)
    spent = select_start_poses(energy, settings)
    assert spent <= 2 * settings.optimiser.refresh_steps + 2
    assert error_mm(optimize(two.problem, settings), two).amax() < 5


def test_other_starts_are_never_worse(two, monkeypatch):
    monkeypatch.setattr(schedule, "RESTART_ERROR", 0.0)
    problem = tilted(two.problem, (35.0, 0.0))
    ends = {}
    for starts in (1, 3, 5):
        settings = adjusted(JOINT, optimiser__steps=20, optimiser__refresh_steps=10, restarts=starts)
        energy = JointEnergy(problem, settings)
        trace = minimise_with_restarts(energy, settings)
        ends[starts] = float(total_energy(energy()).detach())
        assert sum(trace.end.values()) == pytest.approx(ends[starts], rel=1e-3)
    print({k: round(v, 2) for k, v in ends.items()})
    assert ends[3] <= 1.02 * ends[1]
    assert ends[5] <= 1.02 * ends[1]


def test_each_person_keeps_their_own_best_start(two, monkeypatch):
    """One leans far towards the camera at the start, the other away: each is best served by another start."""
    monkeypatch.setattr(schedule, "RESTART_ERROR", 0.0)
    problem = tilted(two.problem, (15.0, -15.0))
    settings = adjusted(JOINT, restarts=3, optimiser__steps=1, optimiser__refresh_steps=1)
    energy = JointEnergy(problem, settings)
    select_start_poses(energy, settings)
    roots = energy.state.unpack().rotations[:, 0]
    truth = two.problem.rotations0[:, 0]
    off = [math.degrees(roma.rotmat_geodesic_distance(r, t).item()) for r, t in zip(roots, truth, strict=True)]
    print(f"roots off by {off[0]:.1f} and {off[1]:.1f} degrees, 15 at the start")
    assert max(off) < 6


def test_starts_are_the_same_bit_for_bit(two, monkeypatch):
    monkeypatch.setattr(schedule, "RESTART_ERROR", 0.0)
    problem = tilted(two.problem, (20.0, -20.0))
    settings = adjusted(JOINT, optimiser__steps=5, optimiser__refresh_steps=5, restarts=3)
    one, again = optimize(problem, settings), optimize(problem, settings)
    assert torch.equal(one.vertices, again.vertices)


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


def test_who_fails_does_not_spoil_other_starts(two, monkeypatch):
    monkeypatch.setattr(schedule, "RESTART_ERROR", 0.0)
    rotations = two.problem.rotations0.clone()
    rotations[0, 3] = torch.nan
    result = optimize(
        replace(two.problem, rotations0=rotations),
        adjusted(JOINT, optimiser__steps=10, optimiser__refresh_steps=5, restarts=3),
    )
    assert result.failures[0] != ""
    assert result.failures[1] == ""
    assert error_mm(result, two)[1] < 5
