"""When terms join the joint optimisation."""

from __future__ import annotations

from dataclasses import replace

import pytest
import roma
import torch

from physic_core import engine_preset
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.solve import optimize

from .adjusted import adjusted

JOINT, PROX = (engine_preset(name).joint for name in ("default", "prox"))


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


def test_the_result_is_the_minimum_of_the_energy(two):
    problem = tilted(two.problem, (5.0, -5.0))
    settings = adjusted(JOINT, optimiser__steps=20)
    energy = JointEnergy(problem, settings)
    trace = settings.optimiser.minimise(energy)
    assert torch.equal(optimize(problem, settings).transl, energy.state.unpack().transl)
    assert trace.steps == 20


def test_contact_and_penetration_of_prox_are_added_after_three_quarters_of_the_steps(two):
    problem = replace(two.problem, transl0=two.problem.transl0 + torch.tensor([0.0, 0.06, 0.0]))
    prox = adjusted(PROX, optimiser__steps=6, optimiser__refresh_steps=2)
    progress: list[float] = []
    late = optimize(problem, prox, progress.append)
    assert progress == sorted(progress)
    assert progress[-1] == 1.0
    alone = optimize(problem, adjusted(prox, contact__weight=0.0, penetration__weight=0.0))
    assert {"contact", "penetration"} <= set(late.losses)
    assert set(alone.losses) == set(late.losses) - {"contact", "penetration"}
    assert late.steps == 8


def test_prox_reports_losses_from_the_true_start(two):
    problem = replace(two.problem, transl0=two.problem.transl0 + torch.tensor([0.0, 0.06, 0.0]))
    prox = adjusted(PROX, optimiser__steps=20, optimiser__refresh_steps=10)
    energy = JointEnergy(problem, prox)
    energy.add_terms(prox.late_terms(energy.context)[0])
    start = energy()["contact"].sum().item()
    assert optimize(problem, prox).losses["contact"][0] == pytest.approx(start, rel=0.05)
